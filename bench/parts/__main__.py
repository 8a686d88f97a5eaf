"""Find the parts of public assets and draw them: ``python -m bench.parts FOLDER SHEETS [--given] [--split last]``.

The files are found in FOLDER by their hash (`assets.json` says where they are from). Sheets and `found.json` go to
SHEETS; a person grades them (`grades.json`). ``--table`` prints what the grades come to, ``--members [NOUN ...]``
reads members of the families instead, whose parts are known. ``python -m bench.parts.cost`` measures what it costs.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

from bench.parts.assets import Listed, files, listed
from bench.parts.find import Found, found
from bench.parts.grades import code_digest, print_table
from bench.parts.members import print_members
from bench.parts.sheets import drawn, write_sheets


def main() -> None:
    """Do what is asked."""
    parser = argparse.ArgumentParser(description="Find the parts of public assets, and draw them.")
    parser.add_argument("folder", type=Path, nargs="?", help="where the files are")
    parser.add_argument("sheets", type=Path, nargs="?", help="a folder for the pictures")
    parser.add_argument("--split", choices=("tuned", "last"), default="tuned")
    parser.add_argument("--given", action="store_true", help="noun and front are given")
    parser.add_argument("--labels", action="store_true", help="draw what the reading says, not what users are shown")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only these assets")
    parser.add_argument("--table", action="store_true", help="print what the grades come to")
    parser.add_argument("--members", nargs="*", metavar="NOUN", help="read members of the families instead")
    asked = parser.parse_args()
    if asked.table:
        print_table()
    elif asked.members is not None:
        print_members(asked.members)
    elif asked.folder is None or asked.sheets is None:
        parser.error("FOLDER and SHEETS are needed")
    else:
        _run(asked)


def _run(asked: argparse.Namespace) -> None:
    """Read the assets whose files are there, print a line for each, and draw them."""
    # Of the code that was loaded: the files may change while it runs.
    code = code_digest()
    here, images = files(asked.folder), []
    results: dict[str, dict[str, object]] = {}
    for each in listed(asked.split, asked.only):
        if each.sha256 not in here:
            print(f"{each.name:20} is not there", flush=True)
            continue
        try:
            what = found(each, here[each.sha256], given=asked.given, labels=asked.labels)
        except Exception as fault:  # one asset that breaks must not hide the others
            print(f"{each.name:20} {fault!r}", flush=True)
            results[each.name] = {"broken": repr(fault)}
            continue
        results[each.name] = _told(each, what)
        print(_line(each, results[each.name]), flush=True)
        title = f"{each.name}: {each.noun} {each.front}; found {what.reading.noun} {what.reading.front_azimuth_deg:.0f}"
        images.append(drawn(what.body.points @ each.turn.T, what.body.faces, what.parts, title))
    if images:
        write_sheets(images, asked.sheets)
        document = {"code": code, "given": asked.given, "assets": results}
        (asked.sheets / "found.json").write_text(json.dumps(document, indent=1) + "\n")
        print(_summary(results))


def _told(each: Listed, what: Found) -> dict[str, object]:
    reading = what.reading
    return {
        "nouns": {noun: round(reading.probabilities[noun], 3) for noun in what.nouns[:5]},
        "sure": reading.sure,
        "noun": each.is_noun(reading.noun),
        "among_three": any(each.is_noun(noun) for noun in what.nouns[:3]),
        "front_azimuth_deg": round(reading.front_azimuth_deg, 1),
        "front": each.faces(reading.turn),
        "front_sure": reading.front_sure,
        "up": each.stands(reading.turn),
        "margin": None if reading.front_margin is None else round(reading.front_margin, 3),
        "residual": round(reading.residual, 4),
        "parts": {name: int(faces.sum()) for name, faces in what.parts.items()},
        "confidence": {name: round(share, 2) for name, share in reading.confidence.items()},
        "seconds": round(what.seconds, 2),
        "megabytes": round(what.megabytes),
        "faces": len(what.body.faces),
    }


def _line(each: Listed, told: dict[str, object]) -> str:
    names = {True: "right", False: "WRONG", None: "none"}
    said = f"noun {names[bool(told['noun'])]} {told['nouns']} front {names[told['front']]} {told['front_azimuth_deg']}"  # type: ignore[index]
    return f"{each.name:20} {told['seconds']:5} s {told['faces']:6} faces  {said}  {told['parts']}"


def _summary(results: dict[str, dict[str, object]]) -> str:
    read = [each for each in results.values() if "broken" not in each]
    fronts = Counter(each["front"] for each in read)
    seconds = sorted(float(str(each["seconds"])) for each in read)
    return (
        f"{len(read)} read, {len(results) - len(read)} broken; noun first {sum(bool(each['noun']) for each in read)}, "
        f"among three {sum(bool(each['among_three']) for each in read)}; front {fronts[True]} of "
        f"{fronts[True] + fronts[False]}; median {seconds[len(seconds) // 2]} s of one core"
    )


if __name__ == "__main__":
    main()
