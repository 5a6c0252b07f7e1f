"""Rules: conditions that a spec, options, a recording, a mesh, a signal or a plan must meet, each with its message.

A `Rule` is a condition that was looked at, and what to say where it does not hold. `refuse` makes an error of the first
that is broken, `broken_rules` a finding of each. A `RuleBook` has the functions that yield the rules of one kind of
thing, padgen's own and registered ones. Limits, of which a row says more than a rule does, stand in
`padgen/planner/limits.py`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

from padgen.core.errors import Finding, PadgenError, SpecError
from padgen.core.registry import new_extension_table, plugin_code

__all__ = ["Rule", "RuleBook", "broken_rules", "refuse"]

T = TypeVar("T")


class Rule(NamedTuple):
    """A condition that was checked on one thing: whether it `holds`, and the error message for when it does not.

    `where` is the field, option, file or part that it is about, `sentence` what is wrong with it, and `cures` are
    changes of the spec to propose. `code` and `level` are those of the finding, where it makes one.
    """

    holds: bool
    where: str
    sentence: str
    cures: Sequence[Mapping[str, Any]] = ()
    code: str = ""
    level: str = "error"

    @property
    def finding(self) -> Finding:
        """The finding that a broken rule makes."""
        return Finding(self.level, self.code, self.where, self.sentence, tuple(map(dict, self.cures)))


def refuse(*rules: Rule, error: type[PadgenError] = SpecError) -> None:
    """Raise an exception of type `error` with the message of the first of `rules` that does not hold, if any."""
    _raise_first(rules, error)


def broken_rules(rules: Iterable[Rule | Finding]) -> Iterator[Finding]:
    """Yield a finding for each rule that does not hold.

    Where a sentence can only be written once the rule is known to be broken, a function yields its finding itself.
    """
    for rule in rules:
        if isinstance(rule, Finding):
            yield rule
        elif not rule.holds:
            yield rule.finding


class RuleBook(Generic[T]):
    """The rules of one `kind` of thing: `functions` that yield them, in order, then functions registered later.

    A function is called when the rules of those before it have been judged: it may rely on what they refuse.
    """

    def __init__(self, kind: str, *functions: Callable[[T], Iterable[Rule | Finding]]) -> None:
        self.kind = kind
        self._functions = functions
        self._registered: dict[str, Callable[[T], Iterable[Rule | Finding]]] = new_extension_table()

    def register(self, name: str, function: Callable[[T], Iterable[Rule | Finding]]) -> None:
        """Add a function that yields rules, under a `name`; `unregister` removes it.

        Raises
        ------
        SpecError
            The name is taken.
        """
        if name in self._registered:
            raise SpecError(f"there is a rule {name!r} of the {self.kind} already; take another name", "rule")
        self._registered[name] = function

    def unregister(self, name: str) -> None:
        """Remove a registered function; padgen's own cannot be removed."""
        del self._registered[name]

    def findings(self, thing: T) -> Iterator[Finding]:
        """Yield a finding for each rule that the thing breaks."""
        return broken_rules(self._rules(thing))

    def refuse(self, thing: T, error: type[PadgenError] = SpecError) -> None:
        """Raise an exception of type `error` with the message of the first rule that the thing breaks, if any."""
        _raise_first(self._rules(thing), error)

    def _rules(self, thing: T) -> Iterator[Rule | Finding]:
        plugin_code()
        for function in (*self._functions, *self._registered.values()):
            yield from function(thing)


def _raise_first(rules: Iterable[Rule | Finding], error: type[PadgenError]) -> None:
    broken = next(broken_rules(rules), None)
    if broken is not None:
        raise error(broken.message, broken.where, broken.cures)
