"""Completion scripts of bash, zsh and fish for both command lines, and completion of `rosidl-py-gen`.

The scripts of click insert values without quotes. Values may be from other nodes or from files, so a shell must not
expand them: they are quoted for bash and zsh, fish quotes them itself. A value that is not printable is not offered.
"""

from __future__ import annotations

import os
import re
import shlex
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import (
    BashComplete,
    CompletionItem,
    FishComplete,
    ShellComplete,
    ZshComplete,
    add_completion_class,
    get_completion_class,
    split_arg_string,
)

from rosidl_py_gen.generator_cli.command_line import suggestions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rosidl_py_gen.compiler.frontend import Package

# bash splits COMP_WORDS at ":" and "=", so the typed line is passed as well. `read` keeps values with "*" or blanks.
_BASH = r"""%(complete_func)s() {
    local completion
    while IFS= read -r completion; do
        case $completion in
            dir,*) COMPREPLY=(); compopt -o dirnames ;;
            file,*) COMPREPLY=(); compopt -o default ;;
            plain,*) COMPREPLY+=("${completion#plain,}") ;;
        esac
    done < <(COMP_WORDS="${COMP_WORDS[*]}" COMP_CWORD=$COMP_CWORD COMP_LINE="${COMP_LINE:0:COMP_POINT}" \
        COMP_WORDBREAKS="$COMP_WORDBREAKS" %(complete_var)s=bash_complete "$1")
}

complete -o nosort -F %(complete_func)s %(prog_name)s
"""
# -Q: values are quoted already.
_ZSH = r"""#compdef %(prog_name)s

%(complete_func)s() {
    local -a plain described response
    local kind value help
    (( ! $+commands[%(prog_name)s] )) && return 1
    response=("${(@f)$(COMP_WORDS="${words[*]}" COMP_CWORD=$((CURRENT-1)) \
        %(complete_var)s=zsh_complete %(prog_name)s)}")
    for kind value help in ${response}; do
        case $kind in
            dir) _path_files -/ ;;
            file) _path_files -f ;;
            plain) [[ $help == _ ]] && plain+=("$value") || described+=("$value:$help") ;;
        esac
    done
    (( $#described )) && _describe -V unsorted described -U -Q
    (( $#plain )) && compadd -Q -U -V unsorted -a plain
    return 0
}

if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    %(complete_func)s "$@"
else
    compdef %(complete_func)s %(prog_name)s
fi
"""
_BREAKS = "\"'@><=;|&(:"
"""Default of bash's variable COMP_WORDBREAKS: characters at which bash starts a new word."""
_UNSAFE = re.compile(r"[^\w@%+=:,./-]", re.ASCII)


def install_completion(is_process: bool = False) -> None:
    """Register the completion classes of this module for bash, zsh and fish in click.

    Args:
        is_process: True if this process only computes completions; standard error is discarded then.
    """
    if is_process:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    for cls in (_Bash, _Zsh, _Fish):
        add_completion_class(cls)


def completion_script(shell: str, command: click.Command, program: str) -> str:
    """Return the completion script of `program` for bash, zsh or fish."""
    install_completion()
    maker = get_completion_class(shell)
    assert maker is not None
    return maker(command, {}, program, completion_variable(program)).source()


def completion_variable(program: str) -> str:
    """Return the environment variable by which a shell requests completions, as click derives it."""
    return f"_{program}_COMPLETE".replace("-", "_").upper()


def complete_directories(ctx: click.Context, incomplete: str) -> list[CompletionItem]:
    """Make the shell complete names of folders."""
    return [CompletionItem(incomplete, type="dir")]


def complete_files(ctx: click.Context, incomplete: str) -> list[CompletionItem]:
    """Make the shell complete names of files and folders."""
    return [CompletionItem(incomplete, type="file")]


def _option_part(typed: str) -> str:
    """Return the beginning ``--option=`` of the word that is being typed, else "".

    Click does not include it in `incomplete`.
    """
    return typed.partition("=")[0] + "=" if typed.startswith("--") and "=" in typed else ""


def _quote(value: str) -> str:
    """Quote a value for bash and zsh: in quotes if it has blanks, else by backslashes, so that the user can continue
    typing.
    """
    if " " in value:
        return shlex.quote(value) if any(char in value for char in '"\\$`!') else f'"{value}"'
    return _UNSAFE.sub(r"\\\g<0>", value)


class _Safe(ShellComplete):
    """Base of the completion classes. It offers only printable values, and stores the word that the user is typing."""

    _typed = ""

    def get_completion_args(self) -> tuple[list[str], str]:
        args, self._typed = super().get_completion_args()
        return args, self._typed

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem]:
        found = suggestions(lambda: super(_Safe, self).get_completions(args, incomplete))
        return [item for item in found if item.value.isprintable()]

    def format_completion(self, item: CompletionItem) -> str:
        value = self._inserted(item.value) if item.type == "plain" else item.value
        return super().format_completion(CompletionItem(value, item.type, item.help))

    def _inserted(self, value: str) -> str:
        """Return the quoted text by which the shell replaces the typed word."""
        return _option_part(self._typed) + _quote(value)


class _Bash(_Safe, BashComplete):
    source_template = _BASH

    def get_completion_args(self) -> tuple[list[str], str]:
        line = os.environ.get("COMP_LINE")
        if not line:
            return super().get_completion_args()
        words = split_arg_string(line)
        self._typed = _last_word(line)
        return (words[1:-1], words[-1]) if self._typed else (words[1:], "")

    def _inserted(self, value: str) -> str:
        """Return the text by which bash replaces the end of the typed word, after its last ``:`` or ``=``."""
        typed = self._typed
        if typed[:1] in ("'", '"'):  # bash keeps the opening quote and closes it
            return value if typed[0] not in value else _quote(value)
        typed = typed[len(_option_part(typed)) :]
        breaks = os.environ.get("COMP_WORDBREAKS", _BREAKS)
        offset = max((typed.rfind(char) + 1 for char in ":=" if char in breaks), default=0)
        return _quote(value[offset:])


class _Zsh(_Safe, ZshComplete):
    source_template = _ZSH


class _Fish(_Safe, FishComplete):
    source_template = FishComplete.source_template.replace('split ","', 'split -m1 ","')

    def _inserted(self, value: str) -> str:
        return _option_part(self._typed) + value  # fish quotes by itself


def _last_word(line: str) -> str:
    begin, quote, skip = 0, "", False
    for index, char in enumerate(line):
        if skip:
            skip = False
        elif char == "\\" and quote != "'":
            skip = True
        elif quote:
            quote = "" if char == quote else quote
        elif char in "'\"":
            quote = char
        elif char.isspace():
            begin = index + 1
    return line[begin:]


def items(values: Any, incomplete: str) -> list[CompletionItem]:
    """Return completion items for the values that begin with `incomplete`."""
    return [CompletionItem(value) for value in values if value.startswith(incomplete)]


def found_items(find: Callable[[], Iterable[str]], incomplete: str) -> list[CompletionItem]:
    """Return completion items for the values that `find` returns; none if it raises an error or is interrupted."""
    return suggestions(lambda: items(find(), incomplete))


# --- rosidl-py-gen ----------------------------------------------------------------------------------------------------


def complete_packages(ctx: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a package."""
    return items((package.name for package in _packages(ctx)), incomplete)


def complete_interfaces(ctx: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a message, service or action."""
    return items((str(name) for package in _packages(ctx) for name in package.files), incomplete)


def complete_packages_and_interfaces(ctx: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a package; after a ``/``, complete the name of an interface in the package."""
    complete = complete_interfaces if "/" in incomplete else complete_packages
    return complete(ctx, incomplete)


def complete_selection(ctx: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete the last of several package or interface names that are separated by ``:`` or ``;``."""
    *_, last = re.split("[:;]", incomplete)
    before = incomplete.removesuffix(last)
    found = complete_packages_and_interfaces(ctx, last)
    return items((before + item.value for item in found), incomplete)


def _packages(ctx: click.Context) -> list[Package]:
    from rosidl_py_gen.compiler.frontend import SearchPath

    above = ctx.parent.params.get("paths") if ctx.parent else None
    return list(SearchPath.scan((*(above or ()), *(ctx.params.get("paths") or ()))).packages.values())
