"""What Windows would not allow, in every Python process that has this folder on ``PYTHONPATH``.

Below the folder that ``IPMCLAB_WINDOWS_BELOW`` names no file is replaced, renamed or removed that a process has open,
and none replaced or removed that is read-only; none is made whose name stands for a device, or has a letter that names
cannot have. Wherever our code opens a text, it states the encoding: a code page is another one on another computer.
C libraries write decimal commas.
"""

import locale
import os
import re
import sys
import warnings

BELOW = os.path.realpath(os.environ["IPMCLAB_WINDOWS_BELOW"]) + os.sep
DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
LETTERS = re.compile(r'[<>:"|?*\x00-\x1f]|[. ]$')


def place(path, folder=-1):
    """A path as it stands in the lists of open files; empty where it is none below the folder."""
    if not isinstance(path, (str, bytes, os.PathLike)):
        return ""
    at = os.readlink(f"/proc/self/fd/{folder}") if isinstance(folder, int) and folder >= 0 else ""
    path = os.path.join(at, os.fsdecode(path))
    found = os.path.join(os.path.realpath(os.path.dirname(path)), os.path.basename(path))
    return found if found.startswith(BELOW) else ""


def is_open(path):
    """Whether a process has this file open, or one in this folder."""
    for process in filter(str.isdigit, os.listdir("/proc")):
        try:
            for number in os.listdir(f"/proc/{process}/fd"):
                held = os.readlink(f"/proc/{process}/fd/{number}")
                if held == path or held.startswith(path + os.sep):
                    return True
        except OSError:
            continue  # it has ended, or is somebody else's
    return False


def refuse_open(*paths):
    for path in filter(None, paths):
        if is_open(path):
            raise PermissionError(13, "The process cannot access the file: another process is using it", path)


def refuse_read_only(path):
    if path and os.path.isfile(path) and not os.stat(path).st_mode & 0o200:
        raise PermissionError(13, "Access is denied", path)


def refuse_name(path):
    name = os.path.basename(path)
    if name and (DEVICE.fullmatch(name) or LETTERS.search(name)):
        raise OSError(22, "The filename, directory name, or volume label syntax is incorrect", path)


def rules(event, given):
    if event == "open" and (ours := sys.modules.get("ipmclab.platform")) is not None:
        ours._KEEPS_WHAT_IS_OPEN = True
    if event == "os.rename":
        source, target = place(given[0], given[2]), place(given[1], given[3])
        refuse_open(source, target)
        refuse_read_only(target)
        refuse_name(target)
    elif event == "os.remove":
        path = place(given[0], given[1])
        refuse_open(path)
        refuse_read_only(path)
    elif event == "os.mkdir":
        refuse_name(place(given[0], given[2]))
    elif event == "open" and isinstance(given[2], int) and given[2] & os.O_CREAT:
        refuse_name(place(given[0]))


sys.addaudithook(rules)
warnings.filterwarnings("error", category=EncodingWarning, module="ipmclab|virtual_cdaq")
locale.setlocale(locale.LC_ALL, "")
