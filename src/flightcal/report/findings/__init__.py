"""What a run says, one statement after the other, and what each takes from its use: a question is a file."""

from .finding import MARKS, ORDER, Finding, State, in_few_words, temperatures_of, valued
from .likely import UNEXPLAINED, likely
from .noise import noise
from .priors import lasting_noise, prior_conflict
from .sampling import convergence, explanations, interrupted
from .scored import missing, scores
from .thresholds import thresholds
from .unmodelled import heat
from .unseen import heaters, held_channels, holding, width
from .values import resting, stand_in, time_tags
