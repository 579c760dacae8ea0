"""``rosidl-py completion``."""

import click

from rosidl_py_gen.tools import run_command


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of a shell; topic, service and node names come from the live graph.

    \b
    eval "$(rosidl-py completion bash)"          # in ~/.bashrc; zsh: the same in ~/.zshrc
    rosidl-py completion fish > ~/.config/fish/completions/rosidl-py.fish
    """
    run_command("completion", shell=shell)
