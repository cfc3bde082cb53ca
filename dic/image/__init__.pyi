from .given import read_region as read_region
from .pages import list_images as list_images
from .read import read_image as read_image
