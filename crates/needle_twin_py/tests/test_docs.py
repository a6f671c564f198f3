"""The examples in docstrings and in the README run as they stand."""

import doctest
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import needle_twin
import needle_twin.gym

README = Path(__file__).resolve().parents[1] / "README.md"


def documented():
    """Names and docstrings of the package, its classes and functions, and their members."""
    for module in (needle_twin, needle_twin.gym):
        yield module.__name__, module.__doc__
        for name in module.__all__:
            thing = getattr(module, name)
            if inspect.isclass(thing) or callable(thing):
                yield f"{module.__name__}.{name}", thing.__doc__
            if inspect.isclass(thing):
                for member, value in vars(thing).items():
                    yield f"{module.__name__}.{name}.{member}", getattr(value, "__doc__", None)


def examples():
    """Examples as one text for each place: after `>>>`, or indented in a docstring; blocks of Python in the README."""
    for name, text in documented():
        prompted = doctest.DocTestParser().get_examples(text or "")
        if prompted:
            yield pytest.param([example.source for example in prompted], id=name)
        indented = re.findall(r"(?m)^(?: {4}(?:import|from) .*\n(?: {4}.*\n)*)", text or "")
        for number, block in enumerate(indented):
            yield pytest.param([re.sub(r"(?m)^ {4}", "", block)], id=f"{name}-{number}")
    for number, block in enumerate(re.findall(r"(?s)```python\n(.*?)```", README.read_text())):
        yield pytest.param([block], id=f"README-{number}")


ALL = list(examples())


def test_there_are_examples():
    assert len(ALL) >= 6, ALL


@pytest.mark.parametrize("sources", ALL)
def test_example_runs(sources, tmp_path, monkeypatch):
    time_s = np.arange(0, 3, 0.01)
    depth_mm, force_n = 1.0 * time_s, 0.3 * time_s
    rows = "".join(f"{t:.2f},{d:.3f},{f:.4f}\n" for t, d, f in zip(time_s, depth_mm, force_n))
    (tmp_path / "run.csv").write_text("Time (s),Compression (mm),Load (N)\n" + rows)
    monkeypatch.chdir(tmp_path)
    names = {"needle_twin": needle_twin, "time_s": time_s, "depth_mm": depth_mm, "force_n": force_n}
    for source in sources:
        exec(compile(source, "example", "single" if len(sources) > 1 else "exec"), names)
