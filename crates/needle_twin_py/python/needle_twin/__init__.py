"""Digital twin of a needle-insertion test rig.

A needle (or an indenter, or a plate) is driven into soft tissue; the twin says which force the load cell reads and how the
tissue deforms, pose by pose, by meshless total Lagrangian explicit dynamics (MTLED).

>>> import needle_twin
>>> twin = needle_twin.Twin("needle_insertion")
>>> for i in range(1, 101):
...     prediction = twin.step(1e-3 * i, depth_m=1e-5 * i)
>>> prediction.predicted_n            # N, positive resists insertion
>>> twin.displacements()              # m, one row for each of twin.reference_points

Units are SI. Frame `sample`: origin at the centre of the sample's bottom face, z up; an insertion downwards gives a force with positive z.

- `Scene`: what is modelled; `presets()`: the scenes that are compiled in.
- `Twin`: a pose in, a `Prediction` out; `Twin.look_ahead`: what a further motion would bring.
- `Ensemble`: many twins in step, with other values of what isn't known for sure; a pose in, a `ForceBand` out.
- `solve`, `replay`: whole runs; a `Run` has curves, metrics, verdict, and `save` writes the report.
- `Recording`: bags and tables; `calibrate`: values of scene keys from a recording; `layers`: friction and cutting of layers.
- `plan`: where a needle has to enter to meet a target that moves with the tissue.
- `tune`: a scene that is as coarse and fast as a tolerance and a rate of poses ask.
- `needle_twin.gym`: an environment for controllers (needs gymnasium).

Exceptions are subclasses of `NeedleTwinError`; each message says what is wrong, where, and what to do.
"""

from ._needle_twin import (
    BuildError,
    Calibration,
    CalibrationError,
    Diverged,
    Ensemble,
    ForceBand,
    NeedleTwinError,
    PoseRefused,
    Prediction,
    Recording,
    RecordingError,
    Run,
    Scene,
    SceneError,
    Twin,
    __version__,
    calibrate,
    layers,
    plan,
    presets,
    replay,
    solve,
    tune,
)

__all__ = [
    "BuildError",
    "Calibration",
    "CalibrationError",
    "Diverged",
    "Ensemble",
    "ForceBand",
    "NeedleTwinError",
    "PoseRefused",
    "Prediction",
    "Recording",
    "RecordingError",
    "Run",
    "Scene",
    "SceneError",
    "Twin",
    "__version__",
    "calibrate",
    "layers",
    "plan",
    "presets",
    "replay",
    "solve",
    "tune",
]
