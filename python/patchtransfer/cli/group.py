"""Command line: the group of all commands, each of which is loaded when it runs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

import click

from .. import interruption
from .support import COMMAND_LINE, INTERRUPTED, Report, failures, only_own_warnings

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

__all__ = ["Commands"]


class Commands(click.Group):
    """Group of commands that are loaded one at a time, and without tracebacks.

    Also errors and interruptions outside of `failures` are one line.

    Parameters
    ----------
    told : mapping
        Of every command's name, which is that of its module in this package too, what a list of commands says of it:
        the first paragraph of the command's own help.
    """

    def __init__(self, *args: Any, told: Mapping[str, str], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        for name, text in told.items():
            # Stands for the command where only its name and this line are shown.
            self.add_command(click.Command(name, help=text))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command itself; its module is loaded."""
        if cmd_name not in self.commands:
            return None
        return cast(click.Command, getattr(import_module(f".{cmd_name}", __package__), cmd_name))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands, none of which is loaded."""
        click.Group(commands=self.commands).format_commands(ctx, formatter)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names of commands, none of which is loaded, and options."""
        from click.shell_completion import CompletionItem

        names = [name for name in self.list_commands(ctx) if name.startswith(incomplete)]
        found = [CompletionItem(name, help=self.commands[name].get_short_help_str()) for name in names]
        return found + click.Command.shell_complete(self, ctx, incomplete)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """The context, which remembers the command line for reports."""
        line = shlex.join(["patchtransfer", *args])
        context = super().make_context(info_name, args, parent, **extra)
        context.meta[COMMAND_LINE] = line
        return context

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command line; everything that goes wrong from here on is one line on standard error."""
        try:
            with interruption.caught(), only_own_warnings(), failures(Report(None)):
                return super().main(*args, **kwargs)
        except SystemExit as end:
            if end.code == INTERRUPTED:
                interruption.close_at_once()
            raise

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; before click makes an "Aborted!" with status 1 of an interruption."""
        with failures(Report(None)):
            return super().invoke(ctx)
