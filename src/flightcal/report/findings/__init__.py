"""What a run says, one statement after the other, and what each takes from its use: a question is a file."""

from .finding import MARKS, ORDER, Finding, State, in_few_words, temperatures_of, valued
from .model import (
    UNEXPLAINED,
    heat,
    lasting_noise,
    likely,
    noise,
    prior_conflict,
    resting,
    stand_in,
    thresholds,
    time_tags,
)
from .sampling import convergence, explanations, interrupted
from .scored import missing, scores
from .unseen import heaters, held_channels, holding, width
