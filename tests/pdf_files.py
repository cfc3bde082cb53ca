"""Read the PDF files that the commands write, with PDFium; the tests that need one say what is missing."""

import warnings
from pathlib import Path

import pytest


def require_pango() -> None:
    """Skip the test if no PDF can be drawn: pip installs WeasyPrint without the system's library Pango."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of libraries that only later versions need
            import weasyprint  # noqa: F401
    except ImportError:
        pytest.skip("WeasyPrint is not installed (pip install offaxis[pdf])")
    except OSError:
        pytest.skip("Pango is not on this machine (Debian: libpangoft2-1.0-0, libharfbuzz-subset0)")


def page_texts(path: Path) -> list[str]:
    """Return the text of each page of a PDF file, with single spaces."""
    pdfium = pytest.importorskip("pypdfium2")
    document = pdfium.PdfDocument(path)
    return [" ".join(page.get_textpage().get_text_range().split()) for page in document]
