"""Keywords are the fields of their options, and one on a wrong level is told where it belongs."""

import re
from dataclasses import fields
from typing import get_type_hints

import numpy as np
import pytest

import collalign
import pairwise
from collalign.align import CollectionKeywords
from collalign.engine.run_options import RunKeywords
from collalign.nonrigid.map_options import NonrigidKeywords
from collalign.options import AlignKeywords, TwoShapeKeywords
from collalign.products.own import Own, OwnKeywords
from collalign.synchronization.graph import GraphArguments
from collalign.template_landmarks.templates import SemilandmarkKeywords
from data_tools.errors import OptionsError
from data_tools.options import CleaningKeywords, EmbeddingKeywords, SamplingKeywords
from pairwise.matching import MatchKeywords
from pairwise.options import PairKeywords
from pairwise.problem import ProblemArguments

KEYWORDS = (
    *(
        (CleaningKeywords, collalign.options.CleaningOptions),
        (SamplingKeywords, collalign.options.SamplingOptions),
    ),
    *(
        (EmbeddingKeywords, collalign.options.EmbeddingOptions),
        (PairKeywords, collalign.options.PairOptions),
    ),
    *(
        (AlignKeywords, collalign.AlignOptions),
        (TwoShapeKeywords, collalign.options.TwoShapeOptions),
    ),
    *(
        (RunKeywords, collalign.RunOptions),
        (NonrigidKeywords, collalign.maps.NonrigidOptions),
        (OwnKeywords, Own),
    ),
    (SemilandmarkKeywords, collalign.landmarks.SemilandmarkRequest),
)


@pytest.mark.parametrize(("keywords", "options"), KEYWORDS, ids=lambda kind: kind.__name__)
def test_keywords_are_the_fields_and_each_is_documented(keywords, options):
    names = [one.name for one in fields(options)]
    assert [*get_type_hints(keywords)] == names
    for name in names:
        assert re.search(rf"^    {name} : ", options.__doc__, re.MULTILINE), name


def test_keywords_that_are_passed_on_are_those_of_what_takes_them():
    problem = {*ProblemArguments.__annotations__}
    assert {*get_type_hints(MatchKeywords)} == problem | {
        one.name for one in fields(pairwise.MatchOptions)
    }
    assert {*get_type_hints(CollectionKeywords)} == {
        one.name
        for kind in (collalign.AlignOptions, collalign.RunOptions, Own)
        for one in fields(kind)
    }
    for arguments, function in (
        (ProblemArguments, pairwise.Problem),
        (GraphArguments, collalign.synchronization.PairGraph),
    ):
        taken = function.from_user.__kwdefaults__
        assert {*arguments.__annotations__} == {*taken}


@pytest.mark.parametrize(
    ("call", "keywords", "advice"),
    [
        ("align", {"num_points": 3}, "it belongs to sampling: use sampling={'num_points': ...}"),
        ("align", {"num_pionts": 3}, "did you mean sampling={'num_points': ...}?"),
        ("align", {"agd_weight": 1.0}, "use embedding={'agd_weight': ...}"),
        ("align", {"sed": 3}, "did you mean 'seed'?"),
        ("rigid", {"num_points": 3}, "use sampling={'num_points': ...}"),
        ("rigid", {"scaling": "rigid"}, "matched up to scale"),
        ("part", {"scaling": "rigid"}, "sampling={'normalisation': 'none'}"),
    ],
)
def test_a_keyword_of_another_level_is_told_where_it_belongs(call, keywords, advice):
    points = np.random.default_rng(0).random((8, 3))
    function = {
        "align": collalign.align_collection,
        "rigid": collalign.match_rigid,
        "part": collalign.match_in_part,
    }
    given = ([points, points],) if call == "align" else (points, points)
    with pytest.raises(OptionsError, match=re.escape(advice)):
        function[call](*given, **keywords)
