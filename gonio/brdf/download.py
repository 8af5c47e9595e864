"""A download that goes on where it broke off; pooch's own starts again."""

import http.client
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

CHUNK = 65536


class RangeDownloader:
    """Downloader for `pooch.fetch`: collects in `part`, asks for the rest by HTTP Range, hands over when complete.

    within: seconds the whole may take. Raises OSError with a cause in a few words; `part` stays for the next try,
    unless it proves to be no part of the file.
    """

    def __init__(self, part: Path, within: float):
        self.part, self.within = part, within

    def __call__(self, url: str, output_file: Any, pooch: Any) -> None:
        end = time.monotonic() + self.within
        self.part.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._receive(url, end)
        except urllib.error.HTTPError as e:
            if e.code == 416:  # our part is as long as the file, or longer: the server has another file
                self.part.unlink(missing_ok=True)
            raise OSError(f"the server answered {e.code} {e.reason}") from None
        except urllib.error.URLError as e:
            raise OSError(f"no connection: {e.reason}") from None
        except (TimeoutError, http.client.HTTPException) as e:
            raise OSError(f"broke off after {self._size()} bytes: {e or 'too slow'}") from None
        self.part.replace(output_file)

    def _receive(self, url: str, end: float) -> None:
        have = self._size()
        request = urllib.request.Request(url, headers={"Range": f"bytes={have}-"} if have else {})
        with urllib.request.urlopen(request, timeout=max(0.1, min(20, end - time.monotonic()))) as answer:
            resumed = answer.status == 206 and answer.headers.get("Content-Range", "").startswith(f"bytes {have}-")
            length = answer.headers.get("Content-Length")
            with open(self.part, "ab" if resumed else "wb") as stream:
                while chunk := answer.read1(CHUNK):
                    stream.write(chunk)
                    if time.monotonic() > end:
                        raise TimeoutError(f"not done within {self.within:g} s")
        total = answer.headers.get("Content-Range", "").rpartition("/")[2] if resumed else length
        if total and total.isdigit() and self._size() < int(total):
            raise http.client.IncompleteRead(b"", int(total) - self._size())

    def _size(self) -> int:
        return self.part.stat().st_size if self.part.exists() else 0
