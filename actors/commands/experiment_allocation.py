"""``searchlight experiment periods`` and ``allocation``: the paper's allocation tables, ours beside them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from actors.commands.tables import print_table
from actors.terminal import progress_bars, say
from pipeline.errors import InputError
from pipeline.storage.whole_or_nothing import make_folder

PoolFile = Annotated[Path, typer.Option(help="The pool of the paper's networks.")]


def register(app: typer.Typer) -> None:
    """Add the commands to ``searchlight experiment``."""
    app.command()(periods)
    app.command()(allocation)


def periods(pool: PoolFile = Path("configs/pools/paper.yaml")) -> None:
    """Table ilp_periods: the periods of ten networks on seven machines, ours / the paper's."""
    from pipeline.config.pool import load_pool
    from pipeline.experiments.paper_tables import MACHINES
    from pipeline.experiments.periods import FRAME_RATE_HZ, period_cells, period_rows

    cells = period_cells(load_pool(pool), pool)
    title = f"Table ilp_periods, from the mean times at {FRAME_RATE_HZ:g} Hz: ours / the paper's"
    typer.echo(title)
    print_table([("network", *MACHINES), *period_rows(cells)])
    equal = sum(cell.ours == cell.printed for cell in cells)
    typer.echo(f"{equal} of {len(cells)} cells equal")
    typer.echo(
        "The table says 30 Hz and the text worst-case times; the cells are those of 15 Hz and mean times."
    )


def allocation(
    out: Annotated[Path, typer.Option(help="Folder for results and report; kept and used again.")],
    quick: Annotated[bool, typer.Option("--quick", help="A few small cells: within a minute.")] = False,
    literal_limit: Annotated[
        float, typer.Option(help="Seconds for the literal model in each cell; 0 leaves it out.")
    ] = 10.0,
    cell: Annotated[
        list[str] | None, typer.Option(help="Only this cell, such as ilp_eval1a-dps3-v5; again for more.")
    ] = None,
    pool: PoolFile = Path("configs/pools/paper-allocation.yaml"),
    inventory: Annotated[Path, typer.Option(help="The paper's machines.")] = Path(
        "configs/inventories/paper-allocation.yaml"
    ),
) -> None:
    """Tables ilp_eval1 and ilp_eval2: the paper's seconds, the literal model's and ours (about 20 minutes).

    What --out holds is not measured again, unless a longer --literal-limit is given.
    """
    from pipeline.experiments.allocation_report import write_report
    from pipeline.experiments.allocation_times import (
        QUICK_CELLS,
        QUICK_LITERAL_LIMIT_S,
        load_results,
        measure_cells,
    )
    from pipeline.experiments.paper_instance import load_paper_instance
    from pipeline.experiments.paper_tables import CELLS, cells_named

    if not (math.isfinite(literal_limit) and literal_limit >= 0.0):
        raise InputError("--literal-limit", f"{literal_limit:g}", "a number of seconds, 0 or more")
    chosen = cells_named(cell) if cell else QUICK_CELLS if quick else CELLS
    limit_s = min(literal_limit, QUICK_LITERAL_LIMIT_S) if quick else literal_limit
    instance = load_paper_instance(pool, inventory)
    make_folder(out)
    with progress_bars("cells") as progress:
        measure_cells(instance, chosen, out, limit_s, progress)
    results = load_results(instance, out)
    write_report(out, results)
    _print_results(results)
    say(f"see {out / 'report.md'}")


def _print_results(results) -> None:  # type: ignore[no-untyped-def]
    from pipeline.experiments.allocation_report import COLUMNS, NOTES, TITLES, summary_lines, table_rows

    for table, title in TITLES.items():
        if rows := table_rows(results, table):
            typer.echo(title)
            print_table([COLUMNS, *rows], left=0)
            typer.echo()
    for line in (*summary_lines(results), *NOTES):
        typer.echo(line)
