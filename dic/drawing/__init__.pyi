from .page import write_drawing_page as write_drawing_page
