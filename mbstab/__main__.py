"""``python -m mbstab``, and the command ``mbstab``."""


def program() -> None:
    """Run the command; Ctrl-C ends it without a word also while it is being imported."""
    try:
        from mbstab.cli import program

        program()
    except KeyboardInterrupt:
        raise SystemExit(130) from None


if __name__ == "__main__":
    program()
