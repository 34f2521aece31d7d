"""The command ``searchlight``, and ``python -m actors``."""

from __future__ import annotations


def main() -> None:
    """Settle the surroundings, then load and run the command line."""
    from actors.surroundings import settle

    settle()
    from actors.cli import main as command_line

    command_line()


if __name__ == "__main__":
    main()
