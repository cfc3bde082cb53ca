"""A measured tension test that several modules evaluate."""

import numpy as np
import pytest

from tests.command_line import run_dic
from tests.dic.commands.tension_series import AREA_MM2, IMAGES, stress_mpa
from tests.image_files import write_image


@pytest.fixture(scope="session")
def folder(speckle, tmp_path_factory):
    """A folder with the measured images of a tension test, and the machine's record with decimal commas."""
    folder = tmp_path_factory.mktemp("test")
    (folder / "images").mkdir()
    pattern, strains = speckle(seed=31, noise=1.0), np.linspace(0.0, 0.012, IMAGES + 1)
    for k, strain in enumerate(strains):

        def back(x, y, strain=strain):
            return 90 + (x - 90) / (1 - 0.33 * strain), 80 + (y - 80) / (1 + strain)

        write_image(folder / "images" / f"img{k:03d}.png", pattern.draw(back, noise_seed=k))
    lines = ["Machine 5", "Image;Time;Force;Way", ";s;kN;mm"]
    for k, strain in enumerate(strains):
        load_kn = stress_mpa(strain) * AREA_MM2 / 1e3
        lines.append(f"img{k:03d};{0.5 * k:.2f};{load_kn:.6f};{60 * strain:.5f}".replace(".", ","))
    (folder / "machine.csv").write_text("\n".join(lines))
    done = run_dic("correlate", folder / "images", "--subset", 21, "--step", 7, "-o", folder / "r.h5")
    assert done.status == 0, done
    return folder
