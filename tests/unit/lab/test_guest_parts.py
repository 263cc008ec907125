"""The parts of the guest that can be judged without booting it."""

import lzma
import stat

import pytest
from usblab.guest import cpio, image, initramfs, kernel, machine


def entries(archive: bytes):
    """Name, mode, content and device of each entry, read as the kernel's text describes the format."""
    at = 0
    while True:
        assert archive[at : at + 6] == b"070701"
        numbers = [int(archive[at + 6 + 8 * n : at + 14 + 8 * n], 16) for n in range(13)]
        size, name_size = numbers[6], numbers[11]
        name = archive[at + 110 : at + 110 + name_size - 1].decode()
        at += (110 + name_size + 3) // 4 * 4
        if name == "TRAILER!!!":
            return
        yield name, numbers[1], archive[at : at + size], tuple(numbers[9:11])
        at += (size + 3) // 4 * 4


def test_an_archive_holds_what_was_put_in_parents_first():
    archive = cpio.Archive()
    archive.character_device("dev/console", 5, 1)
    archive.file("a/b/c.txt", b"hello", 0o755)
    found = {name: rest for name, *rest in entries(archive.bytes())}
    assert list(found) == ["dev", "dev/console", "a", "a/b", "a/b/c.txt"]
    assert found["dev/console"][2] == (5, 1)
    assert stat.S_ISCHR(found["dev/console"][0])
    assert found["a/b/c.txt"][:2] == [stat.S_IFREG | 0o755, b"hello"]


def test_a_tree_follows_links(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real/module.py").write_text("x")
    (tmp_path / "package").mkdir()
    (tmp_path / "package/linked").symlink_to("../real")
    archive = cpio.Archive()
    archive.tree(tmp_path / "package", "to")
    assert [name for name, *_ in entries(archive.bytes())] == ["to", "to/linked", "to/linked/module.py"]


def test_packages_travel_with_bytecode_that_needs_no_check(tmp_path):
    (tmp_path / "package/__pycache__").mkdir(parents=True)
    (tmp_path / "package/module.py").write_text("x = 1")
    (tmp_path / "package/__pycache__/stale.pyc").write_bytes(b"old")
    archive = cpio.Archive()
    initramfs.add_package(archive, tmp_path / "package", "to")
    found = {name: content for name, _, content, _ in entries(archive.bytes())}
    compiled = {name: content for name, content in found.items() if name.endswith(".pyc")}
    assert "to/package/module.py" in found
    assert [content[4:8] for content in compiled.values()] == [b"\x01\0\0\0"]  # PEP 552: hash, unchecked


def test_modules_are_loaded_after_those_they_depend_on(tmp_path):
    needs = {"usbcore": "usb-common", "usb-common": "", "uvcvideo": "videodev,usbcore", "videodev": "builtin"}
    for name, depends in needs.items():
        (tmp_path / f"{name}.ko").write_bytes(b"\0depends=" + depends.encode() + b"\0")
    order = [path.stem for path in kernel.load_order(tmp_path, ("uvcvideo", "usb_common"))]
    assert order == ["videodev", "usb-common", "usbcore", "uvcvideo"]


def test_the_kernel_is_taken_out_of_its_compressed_image():
    image = b"MZ boot code" + lzma.compress(b"\x7fELF kernel", format=lzma.FORMAT_XZ) + b"appended"
    assert kernel.decompress(image) == b"\x7fELF kernel"


def test_the_image_is_made_of_declared_dependencies_only():
    found = image.distributions("fieldkit-slope")
    assert {"numpy", "h5py", "pyserial", "pyusb", "opencv-python-headless"} <= set(found)
    assert "pytest" not in found


def test_a_missing_program_is_named_with_what_to_type():
    from usblab.guest import packages
    from usblab.guest.missing import MissingPartError

    with pytest.raises(MissingPartError, match=r"no-such-program; run: bash .*usblab/install\.sh"):
        packages.need_programs("sh", "no-such-program")


@pytest.mark.parametrize(
    ("usable", "asked", "tried"), [(True, "", ["kvm", "tcg"]), (True, "tcg", ["tcg"]), (False, "", ["tcg"])]
)
def test_hardware_virtualisation_is_tried_where_it_may_be_used_and_emulation_after_it(
    monkeypatch, usable, asked, tried
):
    # this computer is only one of the three
    monkeypatch.setattr(machine.os, "access", lambda path, mode: usable and path == "/dev/kvm")
    monkeypatch.setenv("USBLAB_ACCEL", asked)
    assert [acceleration.split(",")[0] for acceleration, *_ in machine.accelerations()] == tried
