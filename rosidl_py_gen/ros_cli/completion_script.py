"""``rosidl-py completion``."""

import click

from rosidl_py_gen.ros_cli import root, verb


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@verb
def completion(shell: str) -> None:
    """Print the completion script of a shell. Names of topics, services and nodes come from the live graph.

    \b
    eval "$(rosidl-py completion bash)"          # in ~/.bashrc; zsh: the same in ~/.zshrc
    rosidl-py completion fish > ~/.config/fish/completions/rosidl-py.fish
    """
    from rosidl_py_gen.generator_cli import shells

    click.echo(shells.script(shell, root(), "rosidl-py"))
