"""How collalign is cited, and the papers that a methods section cites for what was done with it."""

#: How collalign itself is cited, as CITATION.cff has it.
SOFTWARE = "The collalign developers. collalign. Version {version}. Computer software, MIT licence."
MARON = (
    "Maron H, Dym N, Kezurer I, Kovalsky S, Lipman Y (2016) Point registration via efficient convex relaxation. ACM "
    "Transactions on Graphics 35(4):73. doi:10.1145/2897824.2925913"
)
LUETHI = (
    "Lüthi M, Gerig T, Jud C, Vetter T (2018) Gaussian process morphable models. IEEE Transactions on Pattern "
    "Analysis and Machine Intelligence 40:1860-1873. doi:10.1109/TPAMI.2017.2739743"
)
GOODALL = (
    "Goodall C (1991) Procrustes methods in the statistical analysis of shape. Journal of the Royal Statistical "
    "Society B 53:285-339."
)
RRPP = (
    "Collyer ML, Adams DC (2018) RRPP: an R package for fitting linear models to high-dimensional data using "
    "residual randomization. Methods in Ecology and Evolution 9:1772-1779. doi:10.1111/2041-210X.13029"
)
DRAKE = (
    "Drake AG, Klingenberg CP (2008) The pace of morphological change: historical transformation of skull shape in "
    "St Bernard dogs. Proceedings of the Royal Society B 275:71-76."
)
GUNZ = (
    "Gunz P, Mitteroecker P, Bookstein FL (2005) Semilandmarks in three dimensions. In: Slice DE (ed) Modern "
    "morphometrics in physical anthropology, 73-98."
)
PEREZ = (
    "Perez SI, Bernal V, Gonzalez PN (2006) Differences between sliding semi-landmark methods in geometric "
    "morphometrics. Journal of Anatomy 208:769-784."
)
OBJECT_SYMMETRY = (
    "Klingenberg CP, Barluenga M, Meyer A (2002) Shape analysis of symmetric structures: quantifying variation among "
    "individuals and asymmetry. Evolution 56:1909-1920."
)
MATCHING_SYMMETRY = (
    "Klingenberg CP, McIntyre GS (1998) Geometric morphometrics of developmental instability: analyzing patterns of "
    "fluctuating asymmetry with Procrustes methods. Evolution 52:1363-1375."
)
REPEATABILITY = (
    "Lessells CM, Boag PT (1987) Unrepeatable repeatabilities: a common mistake. The Auk 104:116-121.",
    "Fruciano C (2016) Measurement error in geometric morphometrics. Development Genes and Evolution 226:139-158.",
)
TWO_BLOCKS = (
    "Rohlf FJ, Corti M (2000) Use of two-block partial least-squares to study covariation in shape. Systematic "
    "Biology 49:740-753.",
    "Adams DC, Collyer ML (2016) On the comparison of the strength of morphological integration across morphometric "
    "datasets. Evolution 70:2623-2631.",
)
ARTICULATED = (
    "Adams DC (1999) Methods for shape analysis of landmark data from articulated structures. Evolutionary Ecology "
    "Research 1:959-970."
)
