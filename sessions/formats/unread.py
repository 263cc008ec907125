"""Files that are not read: what each is, by its ending, and what to save instead."""

from __future__ import annotations

from pathlib import Path

from fieldkit.model.errors import ConfigError

_IMAGES = {
    # endings: what it is, and the program that exports its temperatures
    ".is2 .is3": ("an image of Fluke", "SmartView"),
    ".bmt": ("an image of Testo", "IRSoft"),
    ".irb .irbx": ("a recording of InfraTec", "IRBIS"),
    ".ravi": ("a recording of Optris", "PIX Connect"),
    ".ptw .sfmov .ats .inc": ("a recording of FLIR's research cameras", "Research Studio"),
    ".svt .svx .sit .img .tmx .hir": ("an image of a thermal camera", "the maker's program"),
    ".mp4 .avi .mov .mkv .webm .wmv": ("a video, whose colours are no temperatures", "the camera's program"),
    ".bmp .gif .webp .heic": ("an image, whose colours are no temperatures", "the camera's program"),
    ".npy .npz .mat": ("arrays without times", "tifffile.imwrite or numpy.savetxt"),
}
_TABLES = {
    ".tob1 .tob2 .tob3": ("a binary table of Campbell", "CardConvert, or camp2ascii (PyPI)"),
    ".hobo .dtf .dsf": ("a recording of Onset", "HOBOware"),
    ".gbd .nsd .msr .ttd .ebi .xld .lgr": ("a recording of a logger", "the maker's program"),
    ".tdms .lvm .mdf .mf4": ("a recording of a measuring program", "that program"),
    ".sqlite .sqlite3 .db": ("a database", 'sqlite3 -header -csv FILE "SELECT ..."'),
    ".json .jsonl .ndjson .xml .html": ("a document of values", "pandas.read_json(...).to_csv(...)"),
    ".pkl .pickle .rds .rdata .sav .dta": ("objects of a program", "that program"),
    ".numbers .pdf .doc .docx": ("a document", "the program that shows it"),
    ".grib .grib2 .grb .grb2 .zarr": ("fields of a model", "xarray, as the place's values along time"),
    ".ulg .tlog": ("a log of a drone", "its ground station"),
}
_OTHERS = {
    ".zip .7z .rar .tar .tgz .bz2 .xz .zst": ("an archive", "unpack it, and import what is in it"),
    ".db3": ("a part of a rosbag2", "name its folder"),
}
_FRAMES = "export its temperatures by {} as TIFF or CSV, and import that with its unit"
UNREAD: dict[str, tuple[str, str]] = {
    suffix: (what, fix.format(program))
    for rows, fix in ((_IMAGES, _FRAMES), (_TABLES, "export CSV by {}, and import that"), (_OTHERS, "{}"))
    for suffixes, (what, program) in rows.items()
    for suffix in suffixes.split()
}
"""By ending in small letters: what it is, and the next step."""


def refuse_unread(path: Path) -> None:
    """Raise `ConfigError` for a file that is known and not read: by its ending, or as a table of bytes."""
    suffix = path.suffix.lower()
    if path.is_file():
        with path.open("rb") as file:
            suffix = ".tob1" if file.read(4) == b'"TOB' else suffix
    if suffix in UNREAD:
        what, fix = UNREAD[suffix]
        raise ConfigError(what, place=path, fix=fix)
