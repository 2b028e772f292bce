"""Let `python -m studies.zheng2020` do the paper's experiments again."""

from lightflight.cli.errors import keep_algebra_to_one_thread

if __name__ == "__main__":
    keep_algebra_to_one_thread()  # before NumPy is loaded
    from studies.zheng2020.command import command

    command(prog_name="python -m studies.zheng2020")
