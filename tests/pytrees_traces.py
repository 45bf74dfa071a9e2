"""Ticks trees that `export_traces` wrote with the PyPI package py_trees 2.6 and compares results and leaf events with ours.

    cargo run -p sfg-tree --example export_traces -- target/traces 2000
    python3 -m pip install py_trees==2.6.0
    python3 tests/pytrees_traces.py target/traces

Every file is read twice by py_trees' parser: with the nodes that it knows itself, and with py_trees' own nodes registered under the
names of BehaviorTree.CPP. A tree that behaves differently is run again with nodes that follow one rule of this engine after the
other, and counts under the smallest set of rules that makes it equal:

| rule | py_trees | here |
|---|---|---|
| `round_in_the_next_tick` | Retry and Repeat run for a tick between two rounds | the next round begins at once after a child that took several ticks |
| `parallel_ticks_all` | Parallel ticks all children, then decides, and a failure counts before a success | decides after each child |
| `parallel_thresholds` | the parser passes over `success_count`: one success is enough, and a child that succeeded may be asked again | all children by default |
| `defaults_of_subtree_ports` | are attributes of `BehaviorTree`, the palette is not read | stand in the palette, as BehaviorTree.CPP reads them |

Ends with 1 when a difference is under no rule, or when a tree of a family other than `shared` is refused.
"""

import itertools
import json
import re
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter, defaultdict
from pathlib import Path

import py_trees
from py_trees import behaviours, composites, decorators
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.parsers.behaviour_tree_xml import parse_behaviour_tree_xml
from py_trees.ports import NoDataAvailable, PortInformation, PortsMixin

MAX_SHOWN = 5

events: list[str] = []


class Scripted(PortsMixin, Behaviour):
    """Follows its script: a letter a tick, `|` between activations, the last of each repeats."""

    INPUT_PORTS = {"label": PortInformation(str), "script": PortInformation(str)}
    OUTPUT_PORTS = {}

    def __init__(self, name: str, **kwargs):
        super().__init__(name=name, **kwargs)
        self.n_starts = 0
        self.n_letters = 0

    def initialise(self):
        self.n_starts += 1
        self.n_letters = 0

    def update(self) -> Status:
        event = "start" if self.n_letters == 0 else "tick"
        events.append(f"{self.get_input('label')} {event}")
        try:
            activations = self.get_input("script").split("|")
        except NoDataAvailable:
            return Status.FAILURE
        letters = activations[min(self.n_starts, len(activations)) - 1]
        letter = letters[min(self.n_letters, len(letters) - 1)]
        self.n_letters += 1
        return {"R": Status.RUNNING, "S": Status.SUCCESS, "F": Status.FAILURE}[letter]

    def terminate(self, new_status: Status):
        # Also called when it ends by itself, and for nodes that ended before.
        if new_status == Status.INVALID and self.status == Status.RUNNING:
            events.append(f"{self.get_input('label')} halt")


class Write(PortsMixin, Behaviour):
    """Writes a text to a key."""

    INPUT_PORTS = {"label": PortInformation(str), "text": PortInformation(str)}
    OUTPUT_PORTS = {"to": PortInformation(str)}

    def update(self) -> Status:
        events.append(f"{self.get_input('label')} start")
        self._set_output("to", self.get_input("text"))
        return Status.SUCCESS


LEAVES = {"Scripted": Scripted, "Write": Write}


class WithoutPorts(PortsMixin):
    """A node whose attributes are constants for its constructor."""

    INPUT_PORTS = {}
    OUTPUT_PORTS = {}


def endless(n_rounds: int) -> int:
    return sys.maxsize if n_rounds == -1 else n_rounds


class ForceSuccess(WithoutPorts, decorators.FailureIsSuccess):
    pass


class ForceFailure(WithoutPorts, decorators.SuccessIsFailure):
    pass


class KeepRunningUntilFailure(WithoutPorts, decorators.SuccessIsRunning):
    pass


class AlwaysSuccess(WithoutPorts, behaviours.Success):
    pass


class AlwaysFailure(WithoutPorts, behaviours.Failure):
    pass


class ReactiveSequence(WithoutPorts, composites.Sequence):
    def __init__(self, name: str, children: list, **kwargs):
        super().__init__(name=name, memory=False, children=children, **kwargs)


class ReactiveFallback(WithoutPorts, composites.Selector):
    def __init__(self, name: str, children: list, **kwargs):
        super().__init__(name=name, memory=False, children=children, **kwargs)


class RetryUntilSuccessful(WithoutPorts, decorators.Retry):
    def __init__(self, name: str, child: Behaviour, num_attempts: int = -1, **kwargs):
        super().__init__(name=name, child=child, num_failures=endless(num_attempts), **kwargs)


class Repeat(WithoutPorts, decorators.Repeat):
    def __init__(self, name: str, child: Behaviour, num_cycles: int = -1, **kwargs):
        super().__init__(name=name, child=child, num_success=endless(num_cycles), **kwargs)


class Parallel(WithoutPorts, composites.Parallel):
    """Thresholds as far as policies can say them: one failure ends it, and all children or one must succeed."""

    def __init__(self, name: str, children: list, success_count: int = -1, failure_count: int = 1, **kwargs):
        if failure_count != 1 or success_count not in (-1, 1, len(children)):
            raise ValueError(f"no policy is success_count={success_count}, failure_count={failure_count}")
        policy = ParallelPolicy.SuccessOnOne() if success_count == 1 else ParallelPolicy.SuccessOnAll()
        super().__init__(name=name, policy=policy, children=children, **kwargs)


RENAMED = {
    node.__name__: node
    for node in (
        ForceSuccess,
        ForceFailure,
        KeepRunningUntilFailure,
        AlwaysSuccess,
        AlwaysFailure,
        ReactiveSequence,
        ReactiveFallback,
        RetryUntilSuccessful,
        Repeat,
        Parallel,
    )
}


def tick_rounds(node: decorators.Decorator):
    """A tick of Retry or Repeat that goes on with the next round when the child took more than one tick."""
    if node.status != Status.RUNNING:
        node.initialise()
    while True:
        was_running = node.decorated.status == Status.RUNNING
        yield from node.decorated.tick()
        status = node.update()
        if not (status == Status.RUNNING and was_running and node.decorated.status != Status.RUNNING):
            break
    if status != Status.RUNNING:
        node.stop(status)
    node.status = status
    yield node


class RetryAtOnce(RetryUntilSuccessful):
    def tick(self):
        yield from tick_rounds(self)


class RepeatAtOnce(Repeat):
    def tick(self):
        yield from tick_rounds(self)


def tick_in_order(node: composites.Parallel):
    """A tick of Parallel that decides after each child."""
    if node.status != Status.RUNNING:
        for child in node.children:
            if child.status != Status.INVALID:
                child.stop(Status.INVALID)
    n_wanted = 1 if isinstance(node.policy, ParallelPolicy.SuccessOnOne) else len(node.children)
    status = Status.RUNNING
    for child in node.children:
        if child.status != Status.SUCCESS:
            yield from child.tick()
        if child.status == Status.FAILURE:
            status = Status.FAILURE
            break
        if sum(child.status == Status.SUCCESS for child in node.children) >= n_wanted:
            status = Status.SUCCESS
            break
    if status != Status.RUNNING:
        node.stop(status)
    node.status = status
    yield node


class ParallelInOrder(Parallel):
    def tick(self):
        yield from tick_in_order(self)


class ParallelOfOneInOrder(WithoutPorts, composites.Parallel):
    """With the threshold that the parser of py_trees takes when it finds no policy."""

    def __init__(self, name: str, children: list, success_count: int = -1, failure_count: int = 1, **kwargs):
        super().__init__(name=name, policy=ParallelPolicy.SuccessOnOne(), children=children, **kwargs)

    def tick(self):
        yield from tick_in_order(self)


def defaults_as_attributes(path: Path, folder: Path) -> Path:
    """A copy of the file with the defaults of subtree ports where py_trees looks for them."""
    tree = ElementTree.parse(path)
    trees = {element.attrib["ID"]: element for element in tree.getroot().iter("BehaviorTree")}
    for model in tree.getroot().iterfind("TreeNodesModel/SubTree"):
        for port in model:
            if "default" in port.attrib:
                trees[model.attrib["ID"]].set(port.attrib["name"], port.attrib["default"])
    copy = folder / path.name
    tree.write(copy)
    return copy


def with_rules(nodes: dict, rules: tuple[str, ...]) -> dict:
    """The nodes of a run, some of them replaced by nodes that follow our rules."""
    changed = dict(nodes)
    if "round_in_the_next_tick" in rules:
        changed.update({"RetryUntilSuccessful": RetryAtOnce, "Repeat": RepeatAtOnce})
    has_thresholds = "Parallel" in nodes or "parallel_thresholds" in rules
    if "parallel_ticks_all" in rules:
        changed["Parallel"] = ParallelInOrder if has_thresholds else ParallelOfOneInOrder
    elif has_thresholds:
        changed["Parallel"] = Parallel
    return changed


def load(path: Path, nodes: dict) -> Behaviour:
    py_trees.blackboard.Blackboard.clear()
    return parse_behaviour_tree_xml(str(path), node_registry={**LEAVES, **nodes})


def first_difference(tree: Behaviour, steps: list[dict]) -> str | None:
    for step_idx, step in enumerate(steps):
        events.clear()
        if step["op"] == "halt":
            tree.stop(Status.INVALID)
        else:
            tree.tick_once()
        root = "idle" if tree.status == Status.INVALID else tree.status.name.lower()
        if root != step["root"] or events != step["events"]:
            return f"step {step_idx}: {root} {events}, expected {step['root']} {step['events']}"
    return None


def reason_of(error: Exception) -> str:
    text = str(error)
    if found := re.search(r"Unsupported tag '(\w+)'", text):
        return f"unknown node {found[1]}"
    if found := re.search(r"Failed to instantiate '(\w+)'.*unexpected keyword argument '(\w+)'", text):
        return f"unknown attribute {found[2]} of {found[1]}"
    return f"{type(error).__name__}: {text}"


def rules_for(path: Path, steps: list[dict], nodes: dict, candidates: list[str], folder: Path) -> tuple[str, ...] | None:
    """The smallest set of rules with which the tree is equal."""
    for n_rules in range(1, len(candidates) + 1):
        for rules in itertools.combinations(candidates, n_rules):
            copy = defaults_as_attributes(path, folder) if "defaults_of_subtree_ports" in rules else path
            if first_difference(load(copy, with_rules(nodes, rules)), steps) is None:
                return rules
    return None


def compare(folder: Path, cases: list[dict], nodes: dict, candidates: list[str]) -> int:
    """Prints the counts; gives the number of trees that should have been equal or loaded."""
    counts: dict[str, Counter] = defaultdict(Counter)
    refused, different, unexplained = Counter(), Counter(), []
    n_steps, n_events = 0, 0
    with tempfile.TemporaryDirectory() as copies:
        for case in cases:
            path, count = folder / case["file"], counts[case["family"]]
            count["trees"] += 1
            try:
                tree = load(path, nodes)
            except Exception as error:  # The parser raises whatever a node or the XML reader does.
                count["refused"] += 1
                refused[reason_of(error)] += 1
                if case["family"] != "shared":
                    unexplained.append(f"{case['file']} is refused: {error}")
                continue
            count["loaded"] += 1
            difference = first_difference(tree, case["steps"])
            if difference is None:
                count["equal"] += 1
                n_steps += len(case["steps"])
                n_events += sum(len(step["events"]) for step in case["steps"])
                continue
            count["different"] += 1
            rules = rules_for(path, case["steps"], nodes, candidates, Path(copies))
            if rules is None:
                unexplained.append(f"{case['file']}: {difference}")
            different[" and ".join(rules) if rules else "no rule"] += 1
    columns = ["trees", "loaded", "refused", "equal", "different"]
    print(f"  {'':10}" + "".join(f"{column:>11}" for column in columns))
    counts["all"] = sum(counts.values(), Counter())
    for family, count in counts.items():
        print(f"  {family:10}" + "".join(f"{count[column]:11}" for column in columns))
    print(f"  the equal ones have {n_steps} ticks and halts, {n_events} leaf events")
    for title, by in (("refused", refused), ("different", different)):
        for what, n_trees in by.most_common():
            print(f"  {title}: {n_trees:5}  {what}")
    for line in unexplained[:MAX_SHOWN]:
        print("  " + line, file=sys.stderr)
    return len(unexplained)


def main(folder: Path) -> int:
    py_trees.logging.level = py_trees.logging.Level.ERROR
    cases = json.loads((folder / "traces.json").read_text())
    print("nodes that the parser of py_trees knows itself:")
    n_unexplained = compare(folder, cases, {}, ["parallel_thresholds", "parallel_ticks_all", "defaults_of_subtree_ports"])
    print("nodes of py_trees registered under the names of BehaviorTree.CPP:")
    candidates = ["round_in_the_next_tick", "parallel_ticks_all", "defaults_of_subtree_ports"]
    n_unexplained += compare(folder, cases, RENAMED, candidates)
    return 1 if n_unexplained else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(Path(sys.argv[1])))
