"""Write a page of the report as a PDF file, with the library WeasyPrint, which is an extra."""

import warnings
from pathlib import Path
from typing import Any

from dic.errors import OutputError
from dic.files.writing import replacing
from dic.typing import PathLike


def require_pdf(path: PathLike) -> None:
    """Raise an error if no PDF can be written; call this before the work of the report begins.

    Raises
    ------
    OutputError
        If WeasyPrint, or the system's library Pango that it needs, is not installed.
    """
    _weasyprint(path)


def write_pdf(page: str, path: PathLike) -> None:
    """Write an HTML page as a PDF file, completely or not at all, with the print style of `report.css`.

    Raises `OutputError` if WeasyPrint is not installed, and `OSError` if the file cannot be written.
    """
    library = _weasyprint(path)
    # The page contains all of its pictures. It never reads another file or the network.
    fetcher = library.urls.URLFetcher(allowed_protocols={"data"}, fail_on_errors=True)
    with replacing(Path(path)) as partial:
        library.HTML(string=page, url_fetcher=fetcher).write_pdf(partial)


def _weasyprint(path: PathLike) -> Any:
    try:
        with warnings.catch_warnings():
            # WeasyPrint 70 warns if the system lacks libharfbuzz-subset, which only later versions need.
            warnings.filterwarnings("ignore", "HarfBuzz-Subset", DeprecationWarning)
            import weasyprint
            import weasyprint.urls
    except ImportError as error:
        raise _missing(path, "no such library", "install it with pip install 'offaxis[pdf]'") from error
    except OSError as error:
        # WeasyPrint loads Pango when it is imported, and raises this error if the system does not have it.
        got = "the library without the system's library Pango"
        remedy = "install Pango, such as the packages libpangoft2-1.0-0 and libharfbuzz-subset0 of Debian"
        raise _missing(path, got, remedy) from error
    return weasyprint


def _missing(path: PathLike, got: str, remedy: str) -> OutputError:
    return OutputError(
        str(path), "write PDF", "the library WeasyPrint", got, f"{remedy}, or leave out the PDF"
    )
