#!/usr/bin/python3
"""Holds what the daemon answered against server/openapi.json.

usage: tests/api/contract.py lint             the document on its own
       tests/api/contract.py answers FOLDER   the answers that lib.sh's `request` kept in FOLDER

FOLDER holds for each request N.meta (method, URL, status, "api" or "admin": which listener; a line each),
N.headers and N.body.
Prints one line for each thing that is wrong, then what was looked at; exit status 1 if anything was wrong.
"""
import json
import os
import re
import sys
from collections import Counter
from urllib.parse import urlsplit

from jsonschema import Draft202012Validator, exceptions

METHODS = ("get", "put", "post", "delete", "head", "options")
DOCUMENT = os.path.join(os.path.dirname(__file__), "../../server/openapi.json")

with open(DOCUMENT, encoding="utf-8") as file:
    openapi = json.load(file)
components = None  # the document's, closed
wrong = []
looked_at = Counter()


def say(text):
    if text not in wrong:
        wrong.append(text)


def closed(part):
    """A copy of a schema in which objects that name their members have no others."""
    if isinstance(part, list):
        return [closed(value) for value in part]
    if not isinstance(part, dict):
        return part
    copy = {key: closed(value) for key, value in part.items()}
    if isinstance(part.get("properties"), dict) and part.get("type") == "object":
        copy.setdefault("additionalProperties", False)
    return copy


def shortened(value):
    """A JSON value with only the two ends of its long arrays: of a mesh's numbers some will do."""
    if isinstance(value, dict):
        return {key: shortened(part) for key, part in value.items()}
    if isinstance(value, list):
        return [shortened(part) for part in (value if len(value) <= 60 else value[:30] + value[-30:])]
    return value


def validator(schema):
    """Of a schema within the document: its references are found from the document's root."""
    return Draft202012Validator({"components": components, "allOf": [closed(schema)]})


def resolve(part):
    while "$ref" in part:
        target = openapi
        for key in part["$ref"].removeprefix("#/").split("/"):
            target = target[key.replace("~1", "/").replace("~0", "~")]
        part = target
    return part


# ---- the document ------------------------------------------------------------------------------------


def walk(part, path, visit):
    visit(part, path)
    items = part.items() if isinstance(part, dict) else enumerate(part) if isinstance(part, list) else ()
    for key, value in items:
        walk(value, f"{path}/{key}", visit)


def check_reference(part, path):
    if isinstance(part, dict) and isinstance(part.get("$ref"), str):
        used.add(part["$ref"])
        try:
            resolve(part)
        except (KeyError, TypeError):
            say(f"{path}: nothing at {part['$ref']}")


def check_schema(part, path):
    if not isinstance(part, dict) or not isinstance(part.get("schema"), dict):
        return
    schema = part["schema"]
    looked_at["schemas"] += 1
    try:
        Draft202012Validator.check_schema(schema)
    except exceptions.SchemaError as error:
        say(f"{path}/schema: {error.message}")
        return
    examples = ([part["example"]] if "example" in part else []) + [
        example["value"] for example in part.get("examples", {}).values() if "value" in example
    ]
    for example in examples:
        for error in validator(schema).iter_errors(example):
            say(f"{path}: the example: {error.message[:200]}")


def check_operation(path, method, operation):
    where = f"{method.upper()} {path}"
    looked_at["operations"] += 1
    for member in ("operationId", "summary", "tags", "responses"):
        if not operation.get(member):
            say(f"{where}: no {member}")
    names = [resolve(parameter) for parameter in operation.get("parameters", [])]
    in_path = {parameter["name"] for parameter in names if parameter["in"] == "path"}
    if in_path != set(re.findall(r"\{(\w+)\}", path)):
        say(f"{where}: path parameters {sorted(in_path)}")
    for parameter in names:
        if not parameter.get("description") or "schema" not in parameter:
            say(f"{where}: parameter {parameter['name']} lacks a description or a schema")
        if parameter["in"] == "path" and parameter.get("required") is not True:
            say(f"{where}: path parameter {parameter['name']} must be required")
    if not any(status.startswith("2") for status in operation.get("responses", {})):
        say(f"{where}: no success")
    for status, response in operation.get("responses", {}).items():
        response = resolve(response)
        if not re.fullmatch(r"[1-5]\d\d|default", status) or not response.get("description"):
            say(f"{where}: {status} is no status, or has no description")
        if status[0] in "45" and path != "/readyz" and list(response.get("content", {})) != ["application/problem+json"]:
            say(f"{where}: {status} is not a problem")


def lint():
    walk(openapi, "#", check_reference)
    walk(openapi, "#", check_schema)
    for name in openapi["components"]["schemas"]:
        if f"#/components/schemas/{name}" not in used:
            say(f"the schema {name} is not used")
        Draft202012Validator.check_schema(openapi["components"]["schemas"][name])
    ids = Counter()
    for path, item in openapi["paths"].items():
        for method in METHODS:
            if method in item:
                check_operation(path, method, item[method])
                ids[item[method].get("operationId")] += 1
    for name, count in ids.items():
        if count > 1:
            say(f"operationId {name} is given {count} times")
    if not openapi["openapi"].startswith("3.1."):
        say("not OpenAPI 3.1")


# ---- the answers -------------------------------------------------------------------------------------


def find_path(url):
    """The path template of a URL: (template, item), or (None, None)."""
    path = urlsplit(url).path
    for template in sorted(openapi["paths"], key=lambda t: t.count("{")):
        if re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", template), path):
            return template, openapi["paths"][template]
    return None, None


def read_headers(path):
    """Of the last answer in a file that curl wrote: {name: value}."""
    headers = {}
    with open(path, encoding="latin-1") as lines:
        for line in lines:
            if line.startswith("HTTP/"):
                headers = {}
            elif ":" in line:
                name, value = line.split(":", 1)
                headers[name.strip().lower()] = value.strip()
    return headers


def check_header(where, name, header, value):
    schema = resolve(resolve(header).get("schema", {}))
    if value is None:
        if resolve(header).get("required"):
            say(f"{where}: no header {name}")
        return
    if schema.get("type") == "integer":
        value = int(value) if re.fullmatch(r"-?\d+", value) else value
    for error in validator(schema).iter_errors(value):
        say(f"{where}: header {name}: {error.message[:200]}")


def check_body(where, content, headers, body, is_head):
    media_type = headers.get("content-type", "").split(";")[0].strip().lower()
    if not content:
        if body and not is_head:
            say(f"{where}: a body where the document has none")
        return
    entry = next((content[t] for t in content if t.lower() == media_type), None)
    if entry is None:
        say(f"{where}: {media_type or 'no type'} is not among {sorted(content)}")
        return
    if is_head or "content-encoding" in headers:
        return
    if media_type.endswith("json") and "schema" in entry:
        try:
            value = json.loads(body)
        except ValueError as error:
            say(f"{where}: not JSON: {error}")
            return
        best = exceptions.best_match(validator(entry["schema"]).iter_errors(shortened(value)))
        if best is not None:
            at = "/".join(str(p) for p in best.absolute_path)
            say(f"{where}: body at /{at}: {best.message[:300]}")


def check_problem(where, headers, body):
    """Where no operation is named there can only be a refusal."""
    check_body(where, {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}, headers, body, False)


def check_code(where, description, headers, body):
    """A refusal's code is among those that the document names for its status, as `problem: a, b`."""
    if headers.get("content-type", "").startswith("application/problem+json") and body:
        code = json.loads(body).get("code")
        if code not in re.findall(r"[a-z-]+", description):
            say(f"{where}: {code} is not in \"{description}\"")


def check_unmodified(where, headers):
    """RFC 9110, sections 8.6 and 15.4.5: no length but that of the 200, which is none of ours to have no bytes."""
    if headers.get("content-length") == "0":
        say(f"{where}: Content-Length: 0")
    for name in ("etag", "cache-control"):
        if name not in headers:
            say(f"{where}: no {name}")


def check_answer(stem):
    with open(stem + ".meta", encoding="utf-8", errors="replace") as meta:
        method, url, status, listener = meta.read().split("\n")[:4]
    if status == "000":
        return  # no answer: cut off, or never sent
    headers = read_headers(stem + ".headers")
    body = b""
    if os.path.exists(stem + ".body"):
        with open(stem + ".body", "rb") as file:
            body = file.read()
    template, item = find_path(url)
    where = f"{method} {template or urlsplit(url).path[:80]} {status}"
    looked_at["answers"] += 1
    if status == "304":
        check_unmodified(where, headers)
    # HEAD works wherever GET does.
    operation = (item or {}).get(method.lower(), (item or {}).get("get") if method == "HEAD" else None)
    if operation is None or ("servers" in item) != (listener == "admin"):
        if not re.match(r"[45]", status) and method != "OPTIONS":
            say(f"{where}: not in the document")
        elif method != "HEAD" and method != "OPTIONS":
            check_problem(where, headers, body)
    elif status not in operation["responses"]:
        say(f"{where}: status not in the document")
    else:
        response = resolve(operation["responses"][status])
        kinds.add((method, template, status))
        for name, header in response.get("headers", {}).items():
            check_header(where, name, header, headers.get(name.lower()))
        check_body(where, response.get("content"), headers, body, method == "HEAD")
        check_code(where, response["description"], headers, body)


components = closed(openapi["components"])
used, kinds = set(), set()
if sys.argv[1:] == ["lint"]:
    lint()
elif len(sys.argv) == 3 and sys.argv[1] == "answers":
    for name in sorted(os.listdir(sys.argv[2])):
        if name.endswith(".meta"):
            check_answer(os.path.join(sys.argv[2], name[: -len(".meta")]))
    looked_at["kinds"] = len(kinds)
else:
    sys.exit(__doc__)
print(*wrong, ", ".join(f"{n} {what}" for what, n in looked_at.items()), sep="\n")
sys.exit(1 if wrong else 0)
