"""A few runs from a shell, for who installed the package alone: `needle_twin_py solve needle_insertion --out run`.

The programs of the project do more: nodes, the live page, batches, studies. This has what the module has. Exit codes are theirs: 0, 1 for a
failure, 2 for wrong usage, and 3 where data were lost, the model diverged or does not explain the measurement.
"""

import argparse
import json
import sys

import needle_twin


def value(text):
    """A scene's value as TOML has it; a word is a word."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def change(text):
    key, equals, to = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text}: KEY=VALUE is needed")
    return key, value(to)


def arguments(given):
    parser = argparse.ArgumentParser(prog="needle_twin_py", description="Digital twin of a needle-insertion test rig")
    parser.add_argument("--version", action="version", version=f"needle_twin_py {needle_twin.__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("scenes", help="what is compiled in")
    solve = commands.add_parser("solve", help="runs a scene's own motion")
    solve.add_argument("scene", nargs="?", default="needle_insertion", help="a name or a file")
    replay = commands.add_parser("replay", help="answers the motion of a recording, and compares")
    calibrate = commands.add_parser("calibrate", help="finds values of scene keys from a recording")
    calibrate.add_argument("--fit", nargs="+", required=True, metavar="KEY")
    for command in (replay, calibrate):
        command.add_argument("recording", nargs="+", help="a bag, or a table, or one for the position and one for the force")
        command.add_argument("--scene", help="a name or a file; that of the bag unless given")
        for option in ("position", "position-unit", "force", "force-unit", "time", "time-unit"):
            command.add_argument(f"--{option}", help="as of needle_twin.Recording")
        command.add_argument("--position-zero", type=float, default=0.0)
    for command in (solve, replay, calibrate):
        command.add_argument("--set", action="append", default=[], type=change, metavar="KEY=VALUE", dest="changes")
        command.add_argument("--json", action="store_true", help="print the metrics")
    for command in (solve, replay):
        command.add_argument("--out", help="folder for the report")
    return parser.parse_args(given)


def recording(said):
    names = ("position", "position_unit", "force", "force_unit", "time", "time_unit")
    options = {name: getattr(said, name) for name in names if getattr(said, name) is not None}
    return needle_twin.Recording(said.recording, position_zero=said.position_zero, **options)


def ended(run, said):
    """Says how a run ended, and gives its exit code."""
    if said.out:
        for path in run.save(said.out):
            print(path, file=sys.stderr)
    if said.json:
        print(json.dumps(run.metrics))
    else:
        print(f"verdict   {run.verdict}\nsteps     {run.metrics['steps']}\nchecksum  {run.checksum}")
    for loss in run.losses:
        print(f"warning: {loss}", file=sys.stderr)
    if run.diverged:
        print(f"warning: {run.diverged}", file=sys.stderr)
    explained = run.metrics["verdict"]["explains"]
    nothing = said.command == "replay" and explained == "no measurement"
    return 3 if run.losses or run.diverged or nothing or explained == "no" else 0


def work(said):
    if said.command == "scenes":
        for name, what in needle_twin.presets():
            print(f"{name:24} {what}")
        return 0
    changes = dict(said.changes) or None
    if said.command == "solve":
        return ended(needle_twin.solve(said.scene, changes=changes), said)
    given = recording(said)
    for warning in given.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if said.command == "replay":
        return ended(needle_twin.replay(given, said.scene, changes=changes), said)
    found = needle_twin.calibrate(given, said.fit, said.scene, changes=changes)
    if said.json:
        print(json.dumps(found.to_dict()))
    else:
        for key, number in found.values.items():
            interval = found.interval_95.get(key)
            print(f"{key} = {number:.6g}" + (f"; 95 % within {interval[0]:.6g} to {interval[1]:.6g}" if interval else ""))
        print(f"verdict   {found.verdict}")
    return 3 if found.rejected or given.losses else 0


def main(given=None):
    said = arguments(given)
    try:
        return work(said)
    except needle_twin.NeedleTwinError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
