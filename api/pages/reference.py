"""The reference of the routes for programs, made from the OpenAPI document; it loads nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import orjson
from fastapi import APIRouter, Request, Response

from api.rendering import render

router = APIRouter(tags=["pages"], include_in_schema=False)
_MAX_DEPTH: Final = 6  # of an example; deeper is left out
_PLAIN: Final = {
    "string": "…",
    "date-time": "2026-11-20T08:30:00Z",
    "number": 1.5,
    "integer": 1,
    "boolean": True,
    "array": [],
    "object": {},
}


@router.get("/docs")
def reference(request: Request) -> Response:
    document = request.app.openapi()
    schemas = document["components"]["schemas"]
    tags: dict[str, list[dict[str, Any]]] = {}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            tag = operation.get("tags", ["other"])[0]
            tags.setdefault(tag, []).append(_operation(method, path, operation, schemas))
    return render(request, "docs.html", {"tags": tags, "title": document["info"]["title"]})


def _operation(method: str, path: str, operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> dict[str, Any]:
    given = operation.get("requestBody", {}).get("content", {})
    return {
        "id": f"{method}-{path.strip('/').replace('/', '-').replace('{', '').replace('}', '')}",
        "method": method.upper(),
        "path": path,
        "summary": operation.get("summary", ""),
        "description": operation.get("description", ""),
        "parameters": [_parameter(each) for each in operation.get("parameters", [])],
        "body": _contents(given, schemas),
        "answers": [
            {"status": status, "told": answer["description"], "contents": _contents(answer.get("content", {}), schemas)}
            for status, answer in sorted(operation["responses"].items())
        ],
    }


def _parameter(parameter: Mapping[str, Any]) -> dict[str, Any]:
    schema = parameter.get("schema", {})
    return {
        "name": parameter["name"],
        "place": parameter["in"],
        "is_needed": parameter.get("required", False),
        "type": _type(schema),
        "told": parameter.get("description", schema.get("description", "")),
    }


def _type(schema: Mapping[str, Any]) -> str:
    if "anyOf" in schema:
        return " or ".join(_type(each) for each in schema["anyOf"] if each.get("type") != "null")
    if "$ref" in schema:
        return str(schema["$ref"].rsplit("/", 1)[-1])
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    return str(schema.get("format") or schema.get("pattern") or schema.get("type", "any"))


def _contents(contents: Mapping[str, Any], schemas: Mapping[str, Any]) -> list[dict[str, str]]:
    """Each media type with an example, unless it is that of every problem."""
    shown = []
    for media_type, content in contents.items():
        if media_type == "application/problem+json":
            continue
        example = _example(content.get("schema", {}), schemas, 0) if media_type == "application/json" else None
        text = "" if example is None else orjson.dumps(example, option=orjson.OPT_INDENT_2).decode()
        shown.append({"type": media_type, "example": text})
    return shown


def _example(schema: Mapping[str, Any], schemas: Mapping[str, Any], depth: int) -> object:
    """What a value of this schema looks like: its own example, or one put together from its parts."""
    if "$ref" in schema:
        return _example(schemas[schema["$ref"].rsplit("/", 1)[-1]], schemas, depth)
    own = [schema[name] for name in ("example", "const", "default") if name in schema]
    own += [schema[name][0] for name in ("examples", "enum") if schema.get(name)]
    found: object = own[0] if own else _PLAIN.get(schema.get("format") or schema.get("type", ""))
    if not own and depth < _MAX_DEPTH:
        if "anyOf" in schema:
            found = _example(schema["anyOf"][0], schemas, depth)
        elif "properties" in schema:
            found = {name: _example(part, schemas, depth + 1) for name, part in schema["properties"].items()}
        elif "items" in schema:
            found = [_example(schema["items"], schemas, depth + 1)]
    return found
