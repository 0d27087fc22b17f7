"""Table of what the fault campaign did and found, with its bounds."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from tests.bench.faults.campaign import PARTS, Plan, Tally
from tests.bench.faults.fuzz import BATCH
from tests.bench.faults.matrix import rows, title
from tests.bench.faults.records import KINDS, Violation


def complete(plan: Plan, tally: Tally) -> bool:
    """Tell whether all that was asked was done."""
    shares = sum(len(plan.share(number)) for number in range(plan.stations))
    return sum(tally.done.values()) == shares + len(plan.anybodys())


def show(console: Console, plan: Plan, tally: Tally) -> bool:
    """Print everything; return whether all bounds hold and all was done."""
    done = {part: tally.done[part] for part in PARTS}
    done["messages"] = min(done["messages"] * BATCH, plan.counts["messages"])
    words = ", ".join(f"{done[part]} {part}" for part in PARTS)
    console.print(f"done: {words}; {tally.accepted} accepted ids", highlight=False, soft_wrap=True)
    table = Table(title=f"Fault campaign, seed {plan.seed}", title_justify="left", title_style="bold")
    for head in ("what", "bound", "found", ""):
        table.add_column(head, justify="left" if head in ("what", "") else "right")
    for kind in KINDS:
        found = sum(violation.kind == kind for violation in tally.violations)
        table.add_row(kind, "0", str(found), "[bold red]BROKEN[/]" if found else "[green]holds[/]")
    console.print(table)
    for violation in tally.violations:
        console.print(
            f"{violation.kind}, {_item(plan, violation)}: {violation.what}",
            highlight=False,
            soft_wrap=True,
            markup=False,
        )
        console.print(f"    {plan.repeat(violation)}", highlight=False, soft_wrap=True, markup=False)
    if not complete(plan, tally):
        console.print("not everything that was asked was done", style="red")
    return not tally.violations and complete(plan, tally)


def _item(plan: Plan, violation: Violation) -> str:
    part, _, number = violation.item.partition(":")
    if part != "rows" or not number:
        return violation.item
    return f"{violation.item} ({title(rows(plan.seed, plan.counts['rows'])[int(number)])})"
