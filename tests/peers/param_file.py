"""What `ros2 param load` sets of what `ros2 param dump` wrote: {name: value} as JSON on stdin and on stdout.

Both go through PyYAML. Load takes the text of each value of the file for YAML once more, and gives up where that is none;
text that is cut off is kept as it is. One argument: the file to write, for --params-file, of the node of the second.
"""

import json
import sys

import yaml


def main(path, node):
    tree = {}
    for name, value in json.load(sys.stdin).items():
        branch, *rest = [tree, *name.split(".")]
        for key in rest[:-1]:
            branch = branch.setdefault(key, {})
        branch[rest[-1]] = value
    with open(path, "w") as file:
        yaml.dump({node: {"ros__parameters": tree}}, file, default_flow_style=False)
    with open(path) as file:
        tree = yaml.safe_load(file)[node]["ros__parameters"]
    print(json.dumps(dict(leaves(tree))))


def leaves(tree, prefix=""):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, second_reading(str(value))


def second_reading(text):
    try:
        value = yaml.safe_load(text)
    except yaml.parser.ParserError:
        return text
    mixed = isinstance(value, list) and len({type(v) for v in value}) > 1
    if mixed or value is None:
        return text
    if not isinstance(value, (bool, int, float, str, list)):
        raise TypeError(f"{text!r} is read as {value!r}")
    return value


if __name__ == "__main__":
    main(*sys.argv[1:])
