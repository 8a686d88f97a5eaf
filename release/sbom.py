"""Write the software bill of materials: contents and dependencies of a release, with versions and licences.

    python -m release.sbom -o meshdeform.cdx.json

CycloneDX 1.6 in JSON (https://cyclonedx.org/docs/1.6/json/), by the OWASP library. It describes this environment:
the installed versions of everything that `meshdeform[all]` needs, and the libraries in the web page. The same
environment gives the same file.
"""

from __future__ import annotations

import argparse
import base64
import importlib.metadata as metadata
import json
import os
import sys
import uuid
from datetime import UTC, datetime
from pathlib import Path

from cyclonedx.contrib.hash.factories import HashTypeFactory
from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import ExternalReference, ExternalReferenceType, XsUri
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from packageurl import PackageURL

from release.licences import dependencies, forbidden, licence

__all__ = ["bill_of_materials", "main"]

_VENDORED = Path(__file__).resolve().parents[1] / "service/web/vendor/manifest.json"
_NAMESPACE = uuid.UUID("7d3c2f0e-51a5-4f0b-9d0c-2a51b2f7c8e4")
# Classifiers that name exactly one licence, unlike "BSD License" for example.
_SPDX = {
    "License :: OSI Approved :: MIT License": "MIT",
    "License :: OSI Approved :: Apache Software License": "Apache-2.0",
    "License :: OSI Approved :: Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "License :: OSI Approved :: ISC License (ISCL)": "ISC",
}
_LONGEST_NAME = 120  # of a licence; some distributions give its whole text as the name


def bill_of_materials() -> str:
    """Return the document.

    Raises
    ------
    SystemExit
        A component has no recognisable licence, or one that is not accepted.
    """
    graph = dependencies("all")
    factory = LicenseFactory()
    parts = {name: _distribution(name, factory) for name in sorted(graph)}
    root = parts.pop("meshdeform")
    root.type = ComponentType.APPLICATION
    vendored = _vendored(factory)
    refused = [
        f"{part.name}: {texts or 'states no licence'}"
        for part in [*parts.values(), *vendored]
        if not (texts := "; ".join(str(_text(found)) for found in part.licenses)) or forbidden(texts)
    ]
    if refused:
        raise SystemExit("release/sbom.py: these licences are not accepted:\n" + "\n".join(refused))
    bom = Bom(components=[*parts.values(), *vendored])
    bom.metadata.component = root
    moment = int(os.environ.get("SOURCE_DATE_EPOCH", "0"))
    bom.metadata.timestamp = datetime.fromtimestamp(moment, UTC) if moment else datetime.now(UTC)
    names = " ".join(f"{part.name}=={part.version}" for part in [root, *parts.values(), *vendored])
    bom.serial_number = uuid.uuid5(_NAMESPACE, names)
    known = {**parts, "meshdeform": root}
    for name, needed in graph.items():
        bom.register_dependency(known[name], [known[other] for other in sorted(needed)])
    bom.register_dependency(root, vendored)
    # Imported here because its format checkers take seconds to load.
    from cyclonedx.validation.json import JsonStrictValidator

    text = JsonV1Dot6(bom).output_as_string(indent=2)
    wrong = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if wrong is not None:
        raise SystemExit(f"release/sbom.py: the document does not follow its schema: {wrong}")
    return text + "\n"


def _distribution(name: str, factory: LicenseFactory) -> Component:
    version = metadata.version(name)
    reference = PackageURL("pypi", name=name, version=version)
    text = licence(name)
    return Component(
        name=name,
        version=version,
        bom_ref=str(reference),
        purl=reference,
        description=str(metadata.metadata(name).json.get("summary", "")) or None,
        licenses=[factory.make_from_string(_short(text))] if text else [],
    )


def _vendored(factory: LicenseFactory) -> list[Component]:
    """Return the libraries in the page from their manifest: the packages, and third-party code in them."""
    manifest = json.loads(_VENDORED.read_text())
    found = []
    for package in manifest["packages"]:
        reference = PackageURL("npm", name=package["name"], version=package["version"])
        algorithm, _, encoded = package["integrity"].partition("-")
        found.append(
            Component(
                name=package["name"],
                version=package["version"],
                bom_ref=str(reference),
                purl=reference,
                licenses=[factory.make_from_string(package["license"])],
                hashes=[HashTypeFactory().from_composite_str(f"{algorithm}:{base64.b64decode(encoded).hex()}")],
                external_references=[_home(package["homepage"])],
            )
        )
    inside = {file["part_of"]: file for file in manifest["files"].values() if "part_of" in file}
    return found + [
        Component(
            name=name,
            bom_ref=f"vendored:{name}",
            licenses=[factory.make_from_string(file["license"])],
            external_references=[_home(file["homepage"])],
        )
        for name, file in sorted(inside.items())
    ]


def _home(url: str) -> ExternalReference:
    return ExternalReference(type=ExternalReferenceType.WEBSITE, url=XsUri(url))


def _short(text: str) -> str:
    first = _SPDX.get(text, text).strip().splitlines()[0].removeprefix("License :: OSI Approved :: ")
    return first if len(first) <= _LONGEST_NAME else first[: _LONGEST_NAME - 1] + "…"


def _text(found: object) -> str | None:
    return getattr(found, "value", None) or getattr(found, "id", None) or getattr(found, "name", None)


def main() -> None:
    """Write the bill of materials."""
    parser = argparse.ArgumentParser(description="Write the software bill of materials.")
    parser.add_argument("-o", "--output", type=Path, help="file to write (default: standard output)")
    output = parser.parse_args().output
    text = bill_of_materials()
    if output is None:
        sys.stdout.write(text)
    else:
        output.write_text(text)


if __name__ == "__main__":
    main()
