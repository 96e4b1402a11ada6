"""``ipmclab rig prove``: the hardware check list of a rig, with a dummy load in the place of the strip."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from ipmclab.cli.options import Json
from ipmclab.cli.output import print_json
from ipmclab.errors import InputError

if TYPE_CHECKING:
    from ipmclab.rig.checks.proof import Item

_BEFORE = """Take the strip out and clamp the dummy load: 10 ohm and 100 mF in series. Nothing else may use the chassis.
It takes about half a minute, and gives out at most 1 V."""


def prove(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="A rig file (.toml).", show_default=False)],
    operator: Annotated[str, typer.Option(metavar="NAME", help="Who does it; the report states the name.")] = "",
    yes: Annotated[bool, typer.Option("--yes", help="The dummy load is in the clamp: do not ask.")] = False,
    as_json: Json = False,
) -> None:
    """Prove the hardware of a rig with a dummy load, and keep a report next to the rig file.

    \b
    ipmclab rig prove rig.toml --operator NN
    """
    from ipmclab.rig.checks.proof import proof_of, proof_path, write_proof
    from ipmclab.rig.checks.prove import prove as go_through
    from ipmclab.rig.files.rig_file import library_rigs, load_rig

    if rig in library_rigs():
        raise InputError(
            f"{rig} is the rig in the library: it has no hardware, and no place for a report",
            code="no-hardware",
            where="rig",
            repair="describe your rig in a file; ipmclab rig check looks at it",
        )
    loaded = load_rig(rig)
    interactive = sys.stdin.isatty() and not as_json
    if not yes:
        if not interactive:
            raise InputError(
                "nobody can be asked whether the dummy load is in the clamp",
                code="no-answer",
                where="rig prove",
                repair="take the strip out, clamp the dummy load, and add --yes",
            )
        print(_BEFORE)
        if input("Is it so? [y/N] ").strip().lower() not in ("y", "yes"):
            raise InputError(
                "stopped, nothing was given out", code="not-confirmed", where="rig prove", repair="clamp the dummy load"
            )
    proof = go_through(
        loaded,
        rig,
        ask=_ask if interactive else None,
        operator=operator,
        on_item=None if as_json else _print_item,
    )
    path = proof_path(rig)
    write_proof(proof, path)
    cited = proof_of(loaded, rig)
    if as_json:
        print_json(
            {
                "rig": rig,
                "out": str(path),
                "passed": proof.passed,
                "simulated": proof.simulated,
                "bench": proof.bench,
                "date": proof.date,
                "cited": cited,
                "items": [
                    {
                        "name": item.name,
                        "what": item.what,
                        "status": item.status,
                        "seen": item.found,
                        "repair": item.repair,
                    }
                    for item in proof.items
                ],
            }
        )
    else:
        print(f"\n{'passed' if proof.passed else 'NOT passed'}; the report is {path}")
        print(f"a run on this rig will say: {cited}")
    if not proof.passed:
        raise typer.Exit(1)


def _print_item(item: Item) -> None:
    print(f"{item.status:<9} {item.name:<15} {item.what}: {item.found}", flush=True)
    if item.repair:
        print(f"{'':25} -> {item.repair}", flush=True)


def _ask(question: str) -> str:
    return input(f"\n{question}\n> ")
