"""Where materials come from, and fetching them from a server of our own."""

import hashlib
import http.server
import threading

import pytest
from brdf.tables import isotropic_fields

from gonio.brdf import BrdfFileError, library
from gonio.brdf.tables.tensor_file import write_tensor_file


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "made" / "felt_rgb.bsdf"
    path.parent.mkdir()
    write_tensor_file(path, isotropic_fields(n=24))
    return path.read_bytes()


@pytest.fixture
def server(table, monkeypatch):
    """A server of one table; `cut` = bytes after which it hangs up, `ranges` = what was asked for."""

    class Handler(http.server.BaseHTTPRequestHandler):
        cut, ranges, body = None, [], table

        def do_GET(self):
            asked = self.headers.get("Range")
            type(self).ranges.append(asked)
            start = int(asked.removeprefix("bytes=").rstrip("-")) if asked else 0
            if self.path != "/felt/felt_rgb.bsdf":
                return self.send_error(404)
            if start >= len(self.body):
                return self.send_error(416)
            self.send_response(206 if asked else 200)
            if asked:
                self.send_header("Content-Range", f"bytes {start}-{len(self.body) - 1}/{len(self.body)}")
            self.send_header("Content-Length", str(len(self.body) - start))
            self.end_headers()
            self.wfile.write(self.body[start : type(self).cut])

        def log_message(self, *args):
            pass

    http_server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=http_server.serve_forever, daemon=True).start()
    monkeypatch.setattr(library, "registry", lambda: {"felt_rgb.bsdf": hashlib.sha256(table).hexdigest()})
    yield f"http://127.0.0.1:{http_server.server_port}", Handler
    http_server.shutdown()
    http_server.server_close()


def files(folder):
    return sorted(p.name for p in folder.iterdir()) if folder.exists() else []


def test_fetches_and_finds(server, table, tmp_path, monkeypatch):
    url, handler = server
    monkeypatch.setenv("GONIO_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("GONIO_MATERIALS_URL", url)
    found = library.fetch("felt")
    assert found.path.read_bytes() == table and files(tmp_path / "cache") == ["felt_rgb.bsdf"]
    assert library.find("felt").path == found.path and "fetched" in library.find("felt").origin
    library.fetch("felt")
    assert len(handler.ranges) == 1  # the second came from the cache


def test_goes_on_where_it_broke_off(server, table, tmp_path):
    url, handler = server
    handler.cut = 5000
    with pytest.raises(BrdfFileError, match="broke off after 5000 bytes"):
        library.fetch("felt", tmp_path / "c", url)
    assert files(tmp_path / "c") == [".felt_rgb.bsdf.part"]
    handler.cut = None
    assert library.fetch("felt", tmp_path / "c", url).path.read_bytes() == table
    assert handler.ranges == [None, "bytes=5000-"] and files(tmp_path / "c") == ["felt_rgb.bsdf"]


def test_wrong_checksum_leaves_nothing(server, tmp_path):
    url, handler = server
    handler.body = handler.body[:-1] + b"!"
    with pytest.raises(BrdfFileError, match="wrong checksum"):
        library.fetch("felt", tmp_path / "c", url)
    assert files(tmp_path / "c") == []


def test_a_part_longer_than_the_file_is_dropped(server, table, tmp_path):
    url, _ = server
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / ".felt_rgb.bsdf.part").write_bytes(table + b"more")
    with pytest.raises(BrdfFileError, match="416"):
        library.fetch("felt", tmp_path / "c", url)
    assert library.fetch("felt", tmp_path / "c", url).path.read_bytes() == table


def test_no_network(tmp_path, monkeypatch):
    name = library.fetchable()[0]
    with pytest.raises(BrdfFileError, match="no connection") as e:
        library.fetch(name, tmp_path / "c", "http://127.0.0.1:9", within=5)
    assert "\n" not in str(e.value) and files(tmp_path / "c") == []


def test_unknown_names(server, tmp_path):
    with pytest.raises(BrdfFileError, match=r"not a table that can be fetched.*felt"):
        library.fetch("flet", tmp_path / "c", server[0])
    with pytest.raises(BrdfFileError, match="no such material"):
        library.find("nothing_like_it")
    with pytest.raises(BrdfFileError, match="no such file"):
        library.find("nowhere/x.bsdf")


def test_order_of_the_sources(tmp_path, monkeypatch):
    one, two = tmp_path / "one", tmp_path / "two"
    for folder, name in ((one, "a_rgb.bsdf"), (two, "a_rgb.bsdf"), (two, "b.binary"), (two, "c.bsdf")):
        folder.mkdir(exist_ok=True)
        (folder / name).write_bytes(b"")
    monkeypatch.setenv("GONIO_MATERIALS", f"{one}:{two}")
    monkeypatch.setenv("GONIO_CACHE", str(tmp_path / "none"))
    assert library.find("a").path == one / "a_rgb.bsdf"
    assert library.find("b").path.name == "b.binary" and library.find("c").path.name == "c.bsdf"
    assert library.find(two / "c.bsdf").origin.startswith("file")


def test_registry_has_every_table():
    assert len(library.registry()) == 33 and "chm_orange" in library.fetchable()
    assert all(len(c) == 64 for c in library.registry().values())
