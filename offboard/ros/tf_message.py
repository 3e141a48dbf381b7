"""The type of `/tf` where it is missing: no wheel has `tf2_msgs`, so that its one message is made here, once.

ROS's own generators (rosidl) make C of the definition, g++ makes a library of it, and that stays in the user's cache.
To publish bytes takes no more than the type's support in C. A subscriber finds no difference: name and hash of the type
are those of `tf2_msgs`.

`python -m offboard.ros.tf_message FOLDER` is the part that generates, in a process of its own.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

PACKAGE, NAME = "tf2_msgs", "TFMessage"
_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
_BUILD_TIMEOUT_S = 120.0
_SUPPORT = f"rosidl_typesupport_fastrtps_c__get_message_type_support_handle__{PACKAGE}__msg__{NAME}"
_LIBRARIES = ("geometry_msgs__rosidl_typesupport_fastrtps_c", "geometry_msgs__rosidl_generator_c")


def message_class(of_another: type) -> type:
    """What rclpy takes for the message's class, to publish its bytes. `of_another`: the class of any other message.

    Raises OSError, SubprocessError, ImportError where it cannot be made.
    """
    meta: Any = type(of_another)
    meta.__import_type_support__()
    names = ("_CREATE_ROS_MESSAGE", "_CONVERT_FROM_PY", "_CONVERT_TO_PY", "_DESTROY_ROS_MESSAGE")
    kept = {name: getattr(meta, name) for name in names}
    support = kept | {"_TYPE_SUPPORT": _capsule(), "__import_type_support__": classmethod(lambda cls: None)}
    return type(f"Metaclass_{NAME}", (type,), support)(NAME, (), {})  # type: ignore[no-any-return]


def _capsule() -> object:
    """The handle of the type's support, as Python passes pointers between libraries."""
    function = ctypes.CDLL(str(_library()))[_SUPPORT]
    function.restype = ctypes.c_void_p
    new = ctypes.pythonapi.PyCapsule_New
    new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    capsule: object = new(function(), None, None)
    return capsule


def _prefix() -> Path:
    """Where the wheels have put their headers, libraries and definitions."""
    import geometry_msgs

    return Path(geometry_msgs.__file__).parents[4]


def _library() -> Path:
    library = user_cache_path("indoor-mapping") / f"lib{PACKAGE}-{version('ros-geometry-msgs')}.so"
    if not library.exists():
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            _build(Path(folder)).replace(library)
    return library


def _build(folder: Path) -> Path:
    prefix, library = _prefix(), folder / "library.so"
    environment = os.environ | {"AMENT_PREFIX_PATH": str(prefix)}
    _run([sys.executable, "-m", __name__, str(folder)], environment)
    includes = [f"-I{path}" for path in (folder, prefix / "include", *(prefix / "include").iterdir())]
    sources = [word for file in folder.rglob("*.c") for word in ("-x", "c", str(file))]
    sources += ["-x", "c++", *map(str, folder.rglob("*.cpp")), "-x", "none"]
    links = [f"-L{prefix / 'lib'}", f"-Wl,-rpath,{prefix / 'lib'}", *(f"-l{name}" for name in _LIBRARIES)]
    _run(["g++", "-w", "-O1", "-fPIC", "-shared", *includes, *sources, *links, "-o", str(library)], environment)
    return library


def _run(command: list[str], environment: dict[str, str]) -> None:
    subprocess.run(command, check=True, capture_output=True, timeout=_BUILD_TIMEOUT_S, env=environment)


def _generate(folder: Path) -> None:
    """The sources of the message in C, below `folder`."""
    from rosidl_adapter.msg import convert_msg_to_idl
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_type_description.cli import HashTypeDescription
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport

    definition, out = Path("msg") / f"{NAME}.msg", folder / PACKAGE
    (folder / "msg").mkdir()
    (folder / definition).write_text(_DEFINITION, encoding="utf-8")
    convert_msg_to_idl(folder, PACKAGE, definition, folder / "msg")
    files, known = [f"{folder}:{definition.with_suffix('.idl')}"], [str(_prefix() / "share")]
    out.mkdir()
    described = HashTypeDescription("").generate_type_hashes(PACKAGE, files, known, out)
    GenerateC("").generate(PACKAGE, files, known, out, list(map(str, described)))
    GenerateFastRTPSCTypesupport("").generate(PACKAGE, files, known, out)


if __name__ == "__main__":
    _generate(Path(sys.argv[1]))
