"""Idioms of setup.py files in public ROS packages, and what setuptools installs for them.

Each idiom is a piece of code that adds rows to `data_files`, or lines to `scripts_lines`, the console scripts. Pieces
can follow each other in any order. `_N` becomes a number, which makes their names unique.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

FILES = (
    *("package.xml", "README.md", "top.launch.py", "resource/foo", "foo/__init__.py", "foo/n1.py", "foo/n2.py"),
    *("foo/data.yaml", "launch/a.launch.py", "launch/b.launch.xml", "launch/.hidden", "config/a.yaml"),
    *("config/sub/x.yaml", "config/sub/deep/y.yaml", "params/a.yaml", "models/box/model.sdf", "models/ball/model.sdf"),
    *("models/ball/meshes/ball.stl", "scripts/bar.py", "scripts/tool", "worlds/w.world", "urdf/r.urdf"),
)
"""Files of the package; each contains its path."""
TEXTS = {
    "files.txt": "config/a.yaml\nurdf/r.urdf\n",
    "files.json": '["worlds/w.world"]',
    "windows.txt": "config/a.yaml\r\nurdf/r.urdf\r\n",
    "setup.cfg": "[develop]\nscript_dir=$base/lib/foo\n[install]\ninstall_scripts=$base/lib/foo\n",
    "helpers.py": "def rows(folder):\n    return [('share/foo/' + folder, [folder + '/w.world'])]\n",
    "foo/version.py": "VERSION = '1.2.3'\nMORE = ['urdf']\n",
}
IMPORTS = """
import functools, itertools, json, os, re, shutil, sys
import os.path as osp
from collections import defaultdict
from glob import glob, iglob
from os import path
from pathlib import Path
from setuptools import find_packages, setup
package_name = "foo"
share = os.path.join("share", package_name)
data_files = [
    ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
    ("share/" + package_name, ["package.xml"]),
]
scripts_lines = ["n1 = foo.n1:main"]
scripts = []
"""
_TREE = """
def tree_N(folder):
    return [(os.path.join(share, top), [os.path.join(top, f) for f in files]) for top, _, files in os.walk(folder)]
"""
STATIC: dict[str, str] = {
    "append": "data_files.append(('share/' + package_name + '/launch', glob('launch/*.launch.py')))",
    "extend": "data_files.extend([(share + '/params', ['params/a.yaml']), (share, ['top.launch.py'])])",
    "augmented": "data_files += [(osp.join(share, 'launch'), glob(osp.join('launch', '*launch.[pxy][yma]*')))]",
    "augmented by a call": _TREE + "data_files += tree_N('config')",
    "extended by a call": _TREE + "data_files.extend(tree_N('models'))",
    "sum": _TREE + "data_files = data_files + tree_N('config') + [(share + '/w', ['worlds/w.world'])]",
    "star": _TREE + "data_files = [*data_files, *tree_N('models')]",
    "slice": _TREE + "data_files[:] = data_files + tree_N('config')",
    "function that changes its argument": """
def package_files_N(files, folders):
    for folder in folders:
        for place, directories, names in os.walk(folder):
            for name in names:
                files.append((os.path.join("share", package_name, place), [os.path.join(place, name)]))
    return files
package_files_N(data_files, ["config/", "models/"])
""",
    "function that returns its argument": """
def more_N(files):
    files.append(("share/%s/worlds" % package_name, ["worlds/w.world"]))
    return files
data_files = more_N(data_files)
""",
    "function that changes a global": """
def add_N(folder):
    global data_files
    data_files += [("share/{}/{}".format(package_name, folder), glob(folder + "/*.yaml"))]
add_N("config")
add_N("params")
""",
    "function that reads a global": """
def add_N(folder):
    data_files.append((f"share/{package_name}/{folder}", sorted(glob(f"{folder}/*.yaml"))))
for one_N in ("config", "params"):
    add_N(one_N)
""",
    "comprehension of names": "data_files += [(path.join(share, d), glob(d + '/*.*')) for d in ('launch', 'worlds')]",
    "paths by folder": """
def package_files_N(files, folders):
    paths = {}
    for folder in folders:
        for (place, directories, names) in os.walk(folder):
            for name in names:
                file_path = os.path.join(place, name)
                install_path = os.path.join("share", package_name, place)
                if install_path in paths.keys():
                    paths[install_path].append(file_path)
                else:
                    paths[install_path] = [file_path]
    for key in paths.keys():
        files.append((key, paths[key]))
    return files
data_files = package_files_N(data_files, ["models", "config"])
""",
    "setdefault": """
paths_N = {}
for place_N, _, names_N in os.walk("models"):
    for name_N in names_N:
        paths_N.setdefault(os.path.join(share, place_N), []).append(os.path.join(place_N, name_N))
data_files += list(paths_N.items())
""",
    "defaultdict": """
paths_N = defaultdict(list)
for file_N in glob("config/**", recursive=True):
    if os.path.isfile(file_N):
        paths_N[os.path.join(share, os.path.dirname(file_N))].append(file_N)
data_files.extend([(place, files) for place, files in paths_N.items()])
""",
    "generate": """
def generate_data_files_N(share_path, dir):
    data_files = []
    for path, _, files in os.walk(dir):
        list_entry = (share_path + path, [os.path.join(path, f) for f in files if not f.startswith('.')])
        data_files.append(list_entry)
    return data_files
data_files += generate_data_files_N("share/" + package_name + "/", "launch")
""",
    "pathlib": """
for file_N in Path("models").rglob("*"):
    if file_N.is_file():
        data_files.append((str(Path("share") / package_name / file_N.parent), [str(file_N)]))
""",
    "path of the file": """
here_N = Path(__file__).parent
data_files += [(share + "/c", [str(p.relative_to(here_N)) for p in sorted(here_N.glob("config/*.yaml"))])]
""",
    "absolute sources": """
here_N = os.path.dirname(os.path.abspath(__file__))
data_files.append((share + "/urdf", glob(os.path.join(here_N, "urdf", "*"))))
""",
    "listdir": """
data_files.append((share + "/config", [os.path.join("config", f) for f in os.listdir("config")
                                       if os.path.isfile(os.path.join("config", f))]))
""",
    "recursive glob": """
for file_N in glob("config/**/*.yaml", recursive=True):
    data_files.append((os.path.join(share, os.path.dirname(file_N)), [file_N]))
""",
    "sum of lists": _TREE + "data_files += sum([tree_N(d) for d in ('models', 'urdf')], [])",
    "chain": """
for place_N, dirs_N, files_N in itertools.chain.from_iterable(os.walk(d) for d in ["models", "worlds"]):
    target_N = place_N[len("models/"):] if place_N.startswith("models/") else place_N
    data_files.append((os.path.join(share, target_N), [os.path.join(place_N, f) for f in files_N]))
""",
    "zip": "data_files += list(zip([share + '/a', share + '/b'], [['urdf/r.urdf'], ['worlds/w.world']]))",
    "enumerate": """
for i_N, d_N in enumerate(sorted(os.listdir("models"))):
    data_files.append((f"{share}/models/{i_N}", glob(f"models/{d_N}/*.sdf")))
""",
    "dict": """
folders_N = {"launch": "launch/*.py", "params": "params/*"}
data_files += [(os.path.join(share, place), glob(pattern)) for place, pattern in folders_N.items()]
""",
    "lambda": """
rows_N = lambda folder, pattern="*.yaml": (os.path.join(share, folder), glob(os.path.join(folder, pattern)))
data_files += [rows_N("config"), rows_N("urdf", "*.urdf")]
""",
    "union of dicts": """
rows_N = {share + "/w": ["worlds/w.world"]}
alias_N = rows_N
rows_N |= {share + "/u": ["urdf/r.urdf"]}
data_files += alias_N.items()
""",
    "view of a dict": """
rows_N = {}
view_N = rows_N.items()
rows_N[share + "/w"] = ["worlds/w.world"]
data_files += list(view_N) + list(view_N)
""",
    "map": "data_files += map(lambda d: (share + '/' + d, glob(d + '/*.yaml')), ['config', 'params'])",
    "filter": "data_files.append((share + '/config', list(filter(os.path.isfile, glob('config/*')))))",
    "condition": """
for d_N in ["config", "missing"]:
    if os.path.exists(d_N) and os.path.isdir(d_N):
        data_files.append((os.path.join(share, d_N), [f for f in iglob(d_N + "/*") if not os.path.isdir(f)]))
""",
    "platform": """
if sys.platform == "win32" or os.name == "nt":
    data_files.append((share, ["missing.dll"]))
elif sys.version_info >= (3, 8):
    data_files.append((share, ["README.md"]))
""",
    "file list": """
with open("files.txt") as opened_N:
    for line_N in opened_N.read().splitlines():
        data_files.append((os.path.join(share, "listed"), [line_N]))
""",
    "file list with line ends of Windows": """
with open("windows.txt") as opened_N:
    for line_N in opened_N.readlines():
        data_files.append((os.path.join(share, "listed"), [line_N[:-1]]))
for line_N in Path("windows.txt").read_text().split("\\n")[:-1]:
    data_files.append((os.path.join(share, "read"), [line_N]))
""",
    "closure": """
def outer_N(prefix):
    def inner(folder):
        return (os.path.join(prefix, folder), glob(folder + "/*.world"))
    return [inner("worlds")]
data_files += outer_N(share)
""",
    "insert": "data_files.insert(0, (share + '/urdf', ['urdf/r.urdf']))",
    "alias": "other_N = data_files\nother_N.append((share + '/urdf', glob('urdf/*')))",
    "alias in a dict": "config_N = dict(data=data_files)\nconfig_N['data'].append((share + '/w', glob('worlds/*')))",
    "alias of a row": "row_N = (share + '/w', [])\ndata_files.append(row_N)\nrow_N[1].append('worlds/w.world')",
    "pruned walk": """
for place_N, dirs_N, files_N in os.walk("config"):
    dirs_N[:] = [d for d in dirs_N if d != "deep"]
    data_files.append((os.path.join(share, place_N), [os.path.join(place_N, f) for f in files_N]))
""",
    "continue and break": """
for place_N, dirs_N, files_N in os.walk("models"):
    if not files_N:
        continue
    for file_N in files_N:
        if file_N.endswith((".stl", ".dae")):
            break
        data_files.append((os.path.join(share, place_N), [os.path.join(place_N, file_N)]))
""",
    "early return": """
def rows_N(folder):
    if not os.path.isdir(folder):
        return []
    return [(share + "/" + folder, glob(folder + "/*.urdf"))]
data_files += rows_N("urdf") + rows_N("missing")
""",
    "recursion": """
def below_N(folder):
    found = [(os.path.join(share, folder), [p for p in glob(folder + "/*") if os.path.isfile(p)])]
    for name in sorted(os.listdir(folder)):
        if os.path.isdir(os.path.join(folder, name)):
            found += below_N(os.path.join(folder, name))
    return found
data_files += below_N("models")
""",
    "words": "data_files += [(share + '/words', 'urdf/r.urdf worlds/w.world'.split())]",
    "site-packages": """
data_files.append(
    (f"lib/python{sys.version_info.major}.{sys.version_info[1]}/site-packages/extra_N", ["foo/n1.py"])
)
""",
    "walrus": "if (found_N := glob('urdf/*.urdf')):\n    data_files.append((share + '/urdf', found_N))",
    "default argument": """
def collect_N(folder, found=[]):
    found.append((share + "/" + folder, glob(folder + "/*.y*")))
    return found
collect_N("config")
data_files += collect_N("params")
""",
    "keyword arguments": """
def rows_N(*folders, pattern="*", **more):
    return [(os.path.join(more["top"], folder), glob(os.path.join(folder, pattern))) for folder in folders]
data_files += rows_N("launch", "worlds", pattern="*.*", top=share)
""",
    "while": """
waiting_N = ["models"]
index_N = 0
while index_N < len(waiting_N):
    for name_N in os.listdir(waiting_N[index_N]):
        path_N = waiting_N[index_N] + "/" + name_N
        if os.path.isdir(path_N):
            waiting_N.append(path_N)
        else:
            data_files.append((share + "/" + waiting_N[index_N], [path_N]))
    index_N += 1
""",
    "decorator": """
def twice_N(function):
    def call(folder):
        data_files.append((share + "/d1", ["README.md"]))
        return function(folder)
    return call
@twice_N
def add_N(folder):
    data_files.append((share + "/d2", glob(folder + "/*")))
add_N("urdf")
""",
    "renamed": "data_files += [('share/foo/renamed', ['params/a.yaml']), ('lib/foo', ['scripts/bar.py'])]",
    "text row": "data_files.append('README.md')",
    "console scripts of a comprehension": "scripts_lines += [f'{n}__N = foo.{n}:main' for n in ('n1', 'n2')]",
    "console scripts of a text": """
scripts_lines.append('''
    t1_N = foo.n1:main
    # t2_N = foo.n1:main

    t3_N = foo.n2:main
''')
""",
    "console scripts of files": """
for module_N in sorted(Path("foo").glob("n*.py")):
    scripts_lines.append("%s_N = %s.%s:main" % (module_N.stem, package_name, module_N.stem))
""",
    "scripts": "scripts = ['scripts/bar.py']",
    "scripts of a glob": "scripts += glob('scripts/*')",
}
"""Idioms that are read without running them."""
DYNAMIC: dict[str, str] = {
    "try": """
try:
    data_files.append((share + "/urdf", glob("urdf/*")))
except OSError:
    pass
""",
    "class": """
class Files_N:
    def __init__(self):
        self.rows = []
    def add(self, folder):
        self.rows.append((share + "/" + folder, glob(folder + "/*.yaml")))
        return self
data_files += Files_N().add("config").add("params").rows
""",
    "class that changes a global": """
class Builder_N:
    def add(self):
        data_files.append((share + "/w", ["worlds/w.world"]))
Builder_N().add()
""",
    "generator": """
def rows_N():
    for folder in ("config", "params"):
        yield share + "/" + folder, glob(folder + "/*.yaml")
data_files += rows_N()
""",
    "repeated list": """
rows_N = [(share + "/w", ["worlds/w.world"])]
other_N = rows_N
rows_N *= 2
data_files += other_N
""",
    "pop": "data_files.append((share, ['README.md']))\ndata_files.append((share, ['top.launch.py']))\ndata_files.pop()",
    "remove": "row_N = (share, ['README.md'])\ndata_files.append(row_N)\ndata_files.remove(row_N)",
    "del": "data_files.insert(0, (share, ['README.md']))\ndel data_files[0]",
    "own module": "sys.path.insert(0, '.')\nfrom helpers import rows as rows_N\ndata_files += rows_N('worlds')",
    "own package": """
from foo.version import MORE as more_N
data_files += [(share + '/' + d, glob(d + '/*')) for d in more_N]
""",
    "exec": "exec(\"data_files.append((share + '/w', ['worlds/w.world']))\")",
    "globals": "globals()['data_files'].append((share + '/w', ['worlds/w.world']))",
    "created files": """
os.makedirs("generated", exist_ok=True)
shutil.copy("config/a.yaml", "generated/g.yaml")
data_files.append((share + "/generated", glob("generated/*")))
""",
    "iterator that may be consumed": """
files_N = map(str, Path("urdf").glob("*"))
if os.environ.get("NO_SUCH_VARIABLE"):
    print(sorted(files_N))
data_files.append((share + "/urdf", list(files_N)))
""",
    "iterator of an iterator that may be consumed": """
found_N = iglob("urdf/*")
os.environ.get("NO_SUCH_VARIABLE") and any(file == "a" for file in found_N)
data_files.append((share + "/urdf", [*filter(os.path.isfile, found_N)]))
""",
    "loop over an iterator that may end": """
found_N = (file for file in ("README.md", "top.launch.py", "urdf/r.urdf"))
for file_N in found_N:
    if os.environ.get("PATH"):
        break
data_files.append((share + "/left", list(found_N)))
""",
    "file that may be read": """
opened_N = open("files.txt")
if os.environ.get("NO_SUCH_VARIABLE"):
    opened_N.readlines()
data_files.append((share + "/listed", opened_N.read().split()))
""",
    "line of a file": """
opened_N = open("files.txt")
opened_N.readline()
data_files.append((share + "/listed", opened_N.read().split()))
""",
    "order that may change": """
names_N = ["urdf/r.urdf", "README.md"]
if os.environ.get("PATH"):
    names_N.sort()
data_files.append((share + "/first", [names_N[0]]))
""",
    "reversed keys that may change": """
keys_N = {"README.md": 1}
if os.environ.get("PATH"):
    keys_N["top.launch.py"] = 2
data_files.append((share + "/keys", list(reversed(keys_N.keys()))))
""",
    "reduce": """
data_files = functools.reduce(lambda a, b: a + [(share + '/' + b, glob(b + '/*.yaml'))], ['config'], data_files)
""",
    "scandir": "data_files.append((share + '/c', [e.path for e in os.scandir('config') if e.is_file()]))",
    "regular expression": """
data_files.append((share + "/l", [f for f in glob("launch/*") if re.search(r"launch\\.(py|xml)$", f)]))
""",
    "json": "data_files.append((share + '/json', json.load(open('files.json'))))",
    "match": """
match os.name:
    case "posix":
        data_files.append((share + "/posix", ["README.md"]))
    case _:
        data_files.append((share + "/other", ["README.md"]))
""",
    "environment": "data_files += [(share + '/env', ['README.md'])] if os.environ.get('HOME') else []",
    "local function with the name of another": """
_glob_N = glob
def glob(pattern):
    return [name for name in _glob_N(pattern) if min(name) != "~"]
data_files.append((share + "/worlds", glob("worlds/*")))
glob = _glob_N
""",
    "set": "data_files += [(share + '/s', [f]) for f in {'README.md', 'top.launch.py'}]",
    "callback": """
def each_N(function):
    return [*map(function, ["urdf"])]
data_files += functools.partial(each_N, lambda d: (share + "/" + d, glob(d + "/*")))()
""",
    "comprehension for its effect": "[data_files.append((share + '/' + max(d), ['README.md'])) for d in ('ab', 'cd')]",
    "console scripts of a class": """
class Names_N(list):
    pass
scripts_lines += Names_N([f"m__N = foo.n1:main"])
""",
}
"""Idioms that are not understood: they are reported as uncertain."""
_GLOBAL = "global data_files, scripts, scripts_lines"
_FUNCTION = f"def _f_N(*_):\n    {_GLOBAL}\n    CODE\n    return 1\n"
_METHOD = f"class _C_N:\n    def METHOD(self, *_):\n        {_GLOBAL}\n        CODE\n        return RESULT\n"


def _method(name: str, use: str, result: str = "1") -> str:
    """Return the definition of a class with a method, and code that calls the method."""
    return _METHOD.replace("METHOD", name).replace("RESULT", result) + use


AROUND: dict[str, str] = {
    "none": "CODE",
    "known condition": "if True:\n    CODE",
    "dead code": "if False:\n    CODE",
    "unknown condition": "if os.environ.get('PATH'):\n    CODE",
    "unknown else": "if os.environ.get('NO_SUCH_VARIABLE'):\n    pass\nelse:\n    CODE",
    "try": "try:\n    CODE\nexcept OSError:\n    raise",
    "except": "try:\n    raise ValueError\nexcept ValueError:\n    CODE",
    "loop": "for _w_N in (1,):\n    CODE",
    "unknown loop": "for _w_N in os.environ:\n    CODE\n    break",
    "else of a loop": "for _w_N in []:\n    pass\nelse:\n    CODE",
    "while": "while True:\n    CODE\n    break",
    "function": _FUNCTION + "_f_N()",
    "function that is not called": _FUNCTION,
    "function that may return before": "_p_N = 'PATH'\n"
    + _FUNCTION.replace("CODE", "if not os.environ.get(_p_N):\n        return 1\n    CODE")
    + "_f_N()",
    "callback of unknown code": _FUNCTION + "re.sub('a', lambda match: str(_f_N()), 'a')",
    "key of sort": _FUNCTION + "[1].sort(key=_f_N)",
    "partial": _FUNCTION + "functools.partial(_f_N, 1)()",
    "decorator": "def _d_N(function):\n    function()\n    return function\n@_d_N\n" + _FUNCTION,
    "default": _FUNCTION + "def _g_N(x=_f_N()):\n    return x",
    "unknown and": _FUNCTION + "os.environ.get('PATH') and _f_N()",
    "function of a dict": _FUNCTION + "{'a': _f_N}[os.environ.get('NO_SUCH_VARIABLE', 'a')]()",
    "lazy map": _FUNCTION + "_m_N = map(_f_N, [1])\nlist(_m_N)",
    "lazy map that is not used": _FUNCTION + "_m_N = map(_f_N, [1])",
    "generator": _FUNCTION.replace("return", "yield") + "list(_f_N())",
    "iterator in a comparison": _FUNCTION + "1 in (_f_N(x) for x in [1])",
    "type": _FUNCTION + "type('T', (), dict(run=_f_N))().run()",
    "method": _method("run", "_C_N().run()"),
    "property": _method("run", "_C_N().run").replace("    def", "    @property\n    def"),
    "operator": _method("__add__", "_C_N() + 1"),
    "text": _method("__str__", "f'{_C_N()}'", "''"),
    "iteration": _method("__iter__", "a_N, b_N = _C_N()", "iter([1, 2])"),
    "truth": _method("__bool__", "if _C_N():\n    pass", "True"),
    "comparison": _method("__eq__", "1 in [_C_N()]", "True"),
    "item": _method("__setitem__", "_C_N()[1] = 1"),
    "deletion": _method("__del__", "_c_N = _C_N()\ndel _c_N"),
    "subclass": _method("__init_subclass__", "class _D_N(_C_N):\n    pass"),
    "exception": _method("__init__", "try:\n    raise _C_N\nexcept _C_N:\n    pass", "None").replace(
        "class _C_N", "class _C_N(Exception)"
    ),
    "class in a function": f"""
def _g_N():
    {_GLOBAL}
    rows, old = [], data_files
    class _C_N:
        def add(self):
            rows.append((share + "/in", ["README.md"]))
    _C_N().add()
    data_files = rows + old
_g_N()
CODE
""",
}
"""Code around an idiom, which is executed once or never."""


ENDS: dict[str, str] = {
    "plain": """
setup(name=package_name, version="0.0.1", packages=find_packages(exclude=["test"]), data_files=data_files,
      scripts=scripts, entry_points={"console_scripts": scripts_lines})
""",
    "arguments": """
arguments = {"name": package_name, "version": "0.0.1", "packages": [package_name], "data_files": data_files}
arguments.update(scripts=scripts, entry_points={"console_scripts": scripts_lines})
if __name__ == "__main__":
    setup(**arguments)
""",
    "main": """
def main():
    import setuptools
    setuptools.setup(
        name=package_name, version="0.0.1", packages=[package_name], data_files=data_files, scripts=scripts,
        entry_points="[console_scripts]\\n" + "\\n".join(scripts_lines),
    )

if __name__ == "__main__":
    main()
""",
}
"""Calls of `setup`."""


def placed(code: str, around: str, number: int) -> str:
    """Return an idiom, with a number in its names, inside of other code."""
    margin = next((line for line in AROUND[around].split("\n") if "CODE" in line), "").partition("CODE")[0]
    inner = code.strip("\n").replace("\n", f"\n{margin}")
    return AROUND[around].replace("CODE", inner).replace("_N", f"_{number}")


def write_package(folder: Path, names: Sequence[str], end: str = "plain", around: Sequence[str] = ()) -> None:
    """Write a package whose setup.py consists of some idioms, each with other code around it."""
    for path, text in {**{path: path for path in FILES}, **TEXTS}.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    (folder / "scripts/bar.py").write_text("#!/usr/bin/env python3\nprint('scripts/bar.py')\n")
    (folder / "scripts/bar.py").chmod(0o755)
    (folder / "scripts/tool").write_text("#!/usr/bin/env python3\nprint('scripts/tool')\n")
    (folder / "foo/__init__.py").write_text("# foo/__init__.py\n")
    (folder / "foo/n1.py").write_text("def main():\n    print('foo/n1.py')\n")
    (folder / "foo/n2.py").write_text("def main():\n    print('foo/n2.py')\n")
    (folder / "package.xml").write_text("<package><name>foo</name></package>")
    code = {**STATIC, **DYNAMIC}
    pairs = enumerate(zip_longest(names, around, fillvalue="none"))
    text = "\n".join(placed(code[name], other, number) for number, (name, other) in pairs)
    (folder / "setup.py").write_text(f"{IMPORTS}\n{text}\n{ENDS[end]}")


_SERVER = """
import json, os, sys
import setuptools
for line in sys.stdin:
    folder, out = json.loads(line)
    child = os.fork()
    if not child:
        os.chdir(folder)
        sys.path[0] = folder
        sys.argv = ["setup.py", "-q", "egg_info", "--egg-base", out, "build", "--build-base", out + "/build", "install",
                    "--prefix", out + "/prefix", "--single-version-externally-managed", "--record", out + "/record"]
        os.dup2(2, 1)
        code = compile(open("setup.py").read(), folder + "/setup.py", "exec", dont_inherit=True)
        exec(code, {"__name__": "__main__", "__file__": folder + "/setup.py"})
        os._exit(0)
    print(os.waitpid(child, 0)[1], flush=True)
"""


class Installer:
    """Process that installs packages with setuptools, as colcon calls it."""

    def __init__(self) -> None:
        command = [sys.executable, "-W", "ignore", "-c", _SERVER]
        self._process: Any = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def install(self, folder: Path, out: Path) -> dict[str, str]:
        """Return the contents of the installed files by their paths below the prefix; of programs their names only."""
        out.mkdir(parents=True)
        self._process.stdin.write(json.dumps([str(folder), str(out)]) + "\n")
        self._process.stdin.flush()
        assert self._process.stdout.readline() == "0\n"
        found = {}
        for place, _, names in os.walk(out / "prefix"):
            for name in names:
                path = Path(place, name)
                relative = str(path.relative_to(out / "prefix"))
                if is_compared(relative):
                    found[relative] = "" if is_program(relative) else path.read_text()
        return found

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait()


def is_program(path: str) -> bool:
    return path.startswith(("lib/foo/", "bin/"))


def is_compared(path: str) -> bool:
    """Return True for a file that setup.py, not its Python packages or colcon, decides about."""
    is_module = path.startswith("lib/python") and "/extra" not in path
    is_of_colcon = path in ("share/foo/package.xml", "share/ament_index/resource_index/packages/foo")
    return not is_module and not is_of_colcon and "__pycache__" not in path
