"""The works that a report cites, as BibTeX."""

from collections.abc import Sequence
from typing import Final

BIBTEX: Final = {
    "hbm_residuals": """@software{{hbm_residuals,
  author  = {{{{The hbm-residuals authors}}}},
  title   = {{hbm-residuals: pelvis residuals of a full-body gait model on moving treadmills}},
  version = {{{version}}},
  year    = {{2026}}
}}""",
    "vandeloosdrecht2018": """@mastersthesis{vandeloosdrecht2018,
  author = {van de Loosdrecht, A. E. P.},
  title  = {Inertia compensation for perturbations on instrumented treadmills:
            optimization and validation},
  school = {Delft University of Technology},
  year   = {2018}
}""",
    "vandenbogert2013": """@article{vandenbogert2013,
  author  = {van den Bogert, Antonie J. and Geijtenbeek, Thomas and Even-Zohar, Oshri and
             Steenbrink, Frans and Hardin, Elizabeth C.},
  title   = {A real-time system for biomechanical analysis of human movement and muscle function},
  journal = {Medical \\& Biological Engineering \\& Computing},
  volume  = {51}, number = {10}, pages = {1069--1077}, year = {2013},
  doi     = {10.1007/s11517-013-1076-z}
}""",
    "deleva1996": """@article{deleva1996,
  author  = {de Leva, Paolo},
  title   = {Adjustments to {Zatsiorsky-Seluyanov's} segment inertia parameters},
  journal = {Journal of Biomechanics},
  volume  = {29}, number = {9}, pages = {1223--1230}, year = {1996},
  doi     = {10.1016/0021-9290(95)00178-6}
}""",
    "hnat2014": """@article{hnat2014,
  author  = {Hnat, Sandra K. and van den Bogert, Antonie J.},
  title   = {Inertial compensation for belt acceleration in an instrumented treadmill},
  journal = {Journal of Biomechanics},
  volume  = {47}, number = {15}, pages = {3758--3761}, year = {2014},
  url     = {https://works.bepress.com/antonie_vandenbogert/80/}
}""",
    "hnat2018": """@article{hnat2018,
  author  = {Hnat, Sandra K. and van Basten, Ben J. H. and van den Bogert, Antonie J.},
  title   = {Compensation for inertial and gravity effects in a moving force platform},
  journal = {Journal of Biomechanics},
  year    = {2018},
  url     = {https://engagedscholarship.csuohio.edu/enme_facpub/325}
}""",
    "lu1999": """@article{lu1999,
  author  = {Lu, T.-W. and O'Connor, J. J.},
  title   = {Bone position estimation from skin marker co-ordinates using global optimisation
             with joint constraints},
  journal = {Journal of Biomechanics},
  volume  = {32}, number = {2}, pages = {129--134}, year = {1999},
  doi     = {10.1016/S0021-9290(98)00158-4}
}""",
    "harrington2007": """@article{harrington2007,
  author  = {Harrington, M. E. and Zavatsky, A. B. and Lawson, S. E. M. and Yuan, Z. and
             Theologis, T. N.},
  title   = {Prediction of the hip joint centre in adults, children, and patients with cerebral
             palsy based on magnetic resonance imaging},
  journal = {Journal of Biomechanics},
  volume  = {40}, number = {3}, pages = {595--602}, year = {2007},
  doi     = {10.1016/j.jbiomech.2006.02.003}
}""",
    "ehrig2006": """@article{ehrig2006,
  author  = {Ehrig, Rainald M. and Taylor, William R. and Duda, Georg N. and Heller, Markus O.},
  title   = {A survey of formal methods for determining the centre of rotation of ball joints},
  journal = {Journal of Biomechanics},
  volume  = {39}, number = {15}, pages = {2798--2809}, year = {2006},
  doi     = {10.1016/j.jbiomech.2005.10.002}
}""",
    "bell1990": """@article{bell1990,
  author  = {Bell, Alexander L. and Pedersen, Douglas R. and Brand, Richard A.},
  title   = {A comparison of the accuracy of several hip center location prediction methods},
  journal = {Journal of Biomechanics},
  volume  = {23}, number = {6}, pages = {617--621}, year = {1990},
  doi     = {10.1016/0021-9290(90)90054-7}
}""",
    "zeni2008": """@article{zeni2008,
  author  = {Zeni, J. A. and Richards, J. G. and Higginson, J. S.},
  title   = {Two simple methods for determining gait events during treadmill and overground
             walking using kinematic data},
  journal = {Gait \\& Posture},
  volume  = {27}, number = {4}, pages = {710--714}, year = {2008},
  doi     = {10.1016/j.gaitpost.2007.07.007}
}""",
    "hicks2015": """@article{hicks2015,
  author  = {Hicks, Jennifer L. and Uchida, Thomas K. and Seth, Ajay and Rajagopal, Apoorva and
             Delp, Scott L.},
  title   = {Is my model good enough? {Best} practices for verification and validation of
             musculoskeletal models and simulations of movement},
  journal = {Journal of Biomechanical Engineering},
  volume  = {137}, number = {2}, pages = {020905}, year = {2015},
  doi     = {10.1115/1.4029304}
}""",
    "schuirmann1987": """@article{schuirmann1987,
  author  = {Schuirmann, Donald J.},
  title   = {A comparison of the two one-sided tests procedure and the power approach for
             assessing the equivalence of average bioavailability},
  journal = {Journal of Pharmacokinetics and Biopharmaceutics},
  volume  = {15}, number = {6}, pages = {657--680}, year = {1987},
  doi     = {10.1007/BF01068419}
}""",
}


def bibtex(keys: Sequence[str], software_version: str) -> str:
    """Give the entries of some works.

    Parameters
    ----------
    keys
        Keys of `BIBTEX`.
    software_version
        Version for the entry of this software.
    """
    software = BIBTEX["hbm_residuals"].format(version=software_version)
    return "\n\n".join(software if key == "hbm_residuals" else BIBTEX[key] for key in keys) + "\n"
