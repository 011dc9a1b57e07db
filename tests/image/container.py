"""A container without an engine: a root of its own, read-only, in which a user of no name runs.

The system's programs and this Python, at /usr/local as in Python's own images, can be seen and not
changed. What the image brings is in folders of the test.

Python's own images have a program named python; a system may have python3 alone, as Debian does.
"""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

_SYSTEM = """
set -e
mount --make-rprivate /
look() {{ mkdir -p "$2"; mount --bind "$1" "$2"; mount -o remount,bind,ro "$2"; }}
mount -t tmpfs tmpfs {root}
look /usr {root}/usr
look /etc {root}/etc
if [ -e {python}/bin/python ]; then look {python} {root}/usr/local
else
    mount -t tmpfs tmpfs {root}/usr/local
    mkdir {root}/usr/local/bin
    ln -s {python}/bin/{program} {root}/usr/local/bin/python
    mount -o remount,ro {root}/usr/local
fi
[ {python} = /usr ] || look {python} {root}{python}
for one in bin sbin lib lib64; do
    if [ -L "/$one" ]; then cp -P "/$one" "{root}/$one"
    elif [ -d "/$one" ]; then look "/$one" "{root}/$one"; fi
done
for one in dev proc sys; do mkdir "{root}/$one"; mount --rbind "/$one" "{root}/$one"; done
mkdir {root}/tmp
"""

_PACKAGES = """
for one in /opt/*; do if [ -d "$one" ]; then look "$one" "{root}$one"; fi; done
look "$HOME" "{root}$HOME"
"""
"""Where pip may be told to find packages: for whoever builds, not for whoever runs."""

_ENTER = """
mount -t tmpfs -o mode=1777 tmpfs {root}/tmp
mount -o remount,ro {root}
exec setpriv --no-new-privs chroot --userspec={user} --groups= {root} \\
    env -i --chdir={folder} "$@"
"""


def why_not():
    """Say why there can be no such container here; nothing where there can."""
    if os.geteuid() != 0:
        return "a root of its own needs the rights of root"
    tried = subprocess.run(["unshare", "--mount", "true"], capture_output=True, text=True)
    return tried.stderr.strip()


class Container:
    """What a container's processes see.

    Parameters
    ----------
    root
        An empty folder of the test.
    """

    def __init__(self, root):
        self._root = root
        self._folders = []

    def add(self, source, target, *, writable=False):
        """Let a folder of the test be seen as another."""
        self._folders.append((source, target, writable))

    def start(self, words, environment, *, user="0:0", folder="/", **streams):
        """Start a command with an environment that is all it has."""
        named = {
            "root": shlex.quote(str(self._root)),
            "python": shlex.quote(sys.base_prefix),
            "program": "python{}.{}".format(*sys.version_info[:2]),
            "user": user,
            "folder": shlex.quote(folder),
        }
        builds = user == "0:0"
        script = _SYSTEM + (_PACKAGES if builds else "") + "".join(self._mounts()) + _ENTER
        variables = [f"{name}={value}" for name, value in environment.items()]
        return subprocess.Popen(
            ["unshare", "--mount", "sh", "-c", script.format(**named), "sh", *variables, *words],
            text=True,
            **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams,
        )

    def run(self, words, environment, **options):
        """Run a command to its end; give its code and what it wrote."""
        process = self.start(words, environment, **options)
        out, err = process.communicate(timeout=600)
        return process.returncode, out, err

    def enter(self, process, words, environment, *, user, folder):
        """Run a command in what a running one sees; give its code and what it wrote."""
        uid, gid = user.split(":")
        done = subprocess.run(
            [
                *("nsenter", f"--target={process.pid}", "--mount", "--root", "--"),
                *("setpriv", "--no-new-privs", f"--reuid={uid}", f"--regid={gid}"),
                *("--clear-groups", "env", "-i", f"--chdir={folder}"),
                *(f"{name}={value}" for name, value in environment.items()),
                *words,
            ],
            capture_output=True,
            text=True,
            timeout=600,
        )
        return done.returncode, done.stdout, done.stderr

    def _mounts(self):
        for source, target, writable in self._folders:
            place = f"{{root}}{shlex.quote(target)}"
            if writable:
                yield f"mkdir -p {place}; mount --bind {shlex.quote(str(source))} {place}\n"
            else:
                yield f"look {shlex.quote(str(source))} {place}\n"


def packages_from():
    """What pip needs of this environment to find packages as it does here."""
    kept = ("PIP_", "HOME", "LANG", "http_proxy", "https_proxy", "no_proxy", "SSL_CERT")
    return {name: value for name, value in os.environ.items() if name.startswith(kept)}


def copy_context(root, target, ignored):
    """Copy what a build may see: all that .dockerignore lets through."""
    allowed = [line[1:] for line in ignored.splitlines() if line.startswith("!")]
    assert ignored.startswith("*\n")
    for name in allowed:
        source = Path(root, name)
        if source.is_dir():
            shutil.copytree(source, target / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, target / name)
