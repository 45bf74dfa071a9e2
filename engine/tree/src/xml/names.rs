//! The names of nodes and ports on both sides, and which names are allowed.

use super::problem::XmlFault;
use super::value::{Item, Kind};
use crate::registry::NodeClass;
use crate::spec::When;

/// A node that both sides have.
pub(crate) struct BuiltIn {
    pub(crate) theirs: &'static str,
    pub(crate) ours: &'static str,
    pub(crate) ports: &'static [Port],
    /// Of a switch: its number of cases, which are one port on our side.
    pub(crate) n_cases: usize,
}

/// A port that both sides have.
pub(crate) struct Port {
    pub(crate) theirs: &'static str,
    pub(crate) ours: &'static str,
    pub(crate) kind: Kind,
}

const fn port(theirs: &'static str, ours: &'static str, kind: Kind) -> Port {
    Port { theirs, ours, kind }
}

const fn node(theirs: &'static str, ours: &'static str, ports: &'static [Port]) -> BuiltIn {
    BuiltIn { theirs, ours, ports, n_cases: 0 }
}

const SWITCH: &[Port] = &[port("variable", "variable", Kind::Text)];

const fn switch(theirs: &'static str, n_cases: usize) -> BuiltIn {
    BuiltIn { theirs, ours: "switch", ports: SWITCH, n_cases }
}

macro_rules! loop_node {
    ($theirs:literal, $item:ident) => {
        node(
            $theirs,
            "loop",
            &[
                port("queue", "over", Kind::Items(Item::$item)),
                port("value", "item", Kind::Key),
                port("if_empty", "if_empty", Kind::Result),
            ],
        )
    };
}

/// In the order of their names, for [`find`]. `RateController` is of Nav2.
pub(super) const BUILT_INS: &[BuiltIn] = &[
    node("AlwaysFailure", "always_failure", &[]),
    node("AlwaysSuccess", "always_success", &[]),
    node("AsyncFallback", "async_fallback", &[]),
    node("AsyncSequence", "async_sequence", &[]),
    node("Delay", "delay", &[port("delay_msec", "secs", Kind::Millis)]),
    node("Fallback", "fallback", &[]),
    node("ForceFailure", "force_failure", &[]),
    node("ForceSuccess", "force_success", &[]),
    node("IfThenElse", "if_then_else", &[]),
    node("Inverter", "inverter", &[]),
    node("KeepRunningUntilFailure", "keep_running_until_failure", &[]),
    loop_node!("LoopBool", Bool),
    loop_node!("LoopDouble", Float),
    loop_node!("LoopInt", Int),
    loop_node!("LoopString", Text),
    node("Parallel", "parallel", &[port("success_count", "success", Kind::Int), port("failure_count", "failure", Kind::Int)]),
    node("ParallelAll", "parallel_all", &[port("max_failures", "max_failures", Kind::Int)]),
    node("Precondition", "precondition", &[port("if", "if", Kind::Text), port("else", "else", Kind::Result)]),
    node(RATE_CONTROLLER, "rate_limit", &[port("hz", "hz", Kind::Float)]),
    node("ReactiveFallback", "reactive_fallback", &[]),
    node("ReactiveSequence", "reactive_sequence", &[]),
    node("Repeat", "repeat", &[port("num_cycles", "times", Kind::Int)]),
    node("RetryUntilSuccessful", "retry", &[port("num_attempts", "attempts", Kind::Int)]),
    node("RunOnce", "run_once", &[port("then_skip", "then_skip", Kind::Bool)]),
    node("Script", "script", &[port("code", "code", Kind::Text)]),
    node("ScriptCondition", "script_condition", &[port("code", "code", Kind::Text)]),
    node("Sequence", "sequence", &[]),
    node("SequenceWithMemory", "sequence_with_memory", &[]),
    node(
        "SetBlackboard",
        "set_blackboard",
        &[port("value", "value", Kind::Text), port("output_key", "output_key", Kind::BareKey)],
    ),
    node("SkipUnlessUpdated", "skip_unless_updated", &[port("entry", "entry", Kind::Entry)]),
    node("Sleep", "sleep", &[port("msec", "secs", Kind::Millis)]),
    switch("Switch2", 2),
    switch("Switch3", 3),
    switch("Switch4", 4),
    switch("Switch5", 5),
    switch("Switch6", 6),
    node("Timeout", "timeout", &[port("msec", "secs", Kind::Millis)]),
    node("TryCatch", "try_catch", &[port("catch_on_halt", "catch_on_halt", Kind::Bool)]),
    node("UnsetBlackboard", "unset_blackboard", &[port("key", "key", Kind::BareKey)]),
    node("WaitValueUpdate", "wait_value_update", &[port("entry", "entry", Kind::Entry)]),
    node("WasEntryUpdated", "was_entry_updated", &[port("entry", "entry", Kind::Entry)]),
    node("WhileDoElse", "while_do_else", &[]),
];

/// The ports of a switch that are `cases` on our side.
pub(super) const CASES: [&str; 6] = ["case_1", "case_2", "case_3", "case_4", "case_5", "case_6"];

pub(super) const RATE_CONTROLLER: &str = "RateController";

/// Names that only BehaviorTree.CPP 3 or older has, and what to write today.
const VERSION_3: &[(&str, &str)] = &[
    ("BlackboardCheckBool", "write a ScriptCondition"),
    ("BlackboardCheckDouble", "write a ScriptCondition"),
    ("BlackboardCheckInt", "write a ScriptCondition"),
    ("BlackboardCheckString", "write a ScriptCondition"),
    ("FallbackStar", "write Fallback"),
    ("RetryUntilSuccesful", "write RetryUntilSuccessful"),
    ("SequenceStar", "write SequenceWithMemory"),
    ("SubTreePlus", "write SubTree with _autoremap=\"true\""),
    ("__shared_blackboard", "write _autoremap=\"true\""),
];

/// Our nodes that BehaviorTree.CPP lacks.
const OURS_ONLY: &[&str] = &["recover", "rate_limit"];

/// The node that BehaviorTree.CPP calls so.
pub(super) fn find(theirs: &str) -> Option<&'static BuiltIn> {
    // Most names differ in the first letter, which is cheaper than a call to compare them whole.
    let first = theirs.bytes().next();
    let found = BUILT_INS.binary_search_by(|node| node.theirs.bytes().next().cmp(&first).then_with(|| node.theirs.cmp(theirs)));
    found.ok().map(|node_idx| &BUILT_INS[node_idx])
}

/// The first node of BehaviorTree.CPP that is our `ours`.
pub(crate) fn find_ours(ours: &str) -> Option<&'static BuiltIn> {
    BUILT_INS.iter().find(|node| node.ours == ours)
}

/// Whether the engine itself has a node of this name.
pub(super) fn is_ours(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_lowercase()) && is_one_of_ours(name)
}

fn is_one_of_ours(name: &str) -> bool {
    name == "subtree" || OURS_ONLY.contains(&name) || find_ours(name).is_some()
}

/// Whether BehaviorTree.CPP has no such node though the engine has.
pub(super) fn is_ours_only(name: &str) -> bool {
    OURS_ONLY.contains(&name)
}

/// What to write instead of a name of version 3.
pub(super) fn version_3(name: &str) -> Option<&'static str> {
    VERSION_3.iter().find(|(old, _)| *old == name).map(|(_, help)| *help)
}

/// The class that an element such as `<Action ID="...">` names.
pub(super) fn class_of(element: &str) -> Option<NodeClass> {
    Some(match element {
        "Action" => NodeClass::Action,
        "Condition" => NodeClass::Condition,
        "Control" => NodeClass::Control,
        "Decorator" => NodeClass::Decorator,
        "SubTree" => NodeClass::Subtree,
        _ => return None,
    })
}

/// The element of a class.
pub(super) fn element_of(class: NodeClass) -> &'static str {
    match class {
        NodeClass::Action | NodeClass::Step => "Action",
        NodeClass::Condition => "Condition",
        NodeClass::Control => "Control",
        NodeClass::Decorator => "Decorator",
        NodeClass::Subtree => "SubTree",
    }
}

/// The attribute of a script.
pub(super) fn attribute_of(when: When) -> &'static str {
    match when {
        When::FailureIf => "_failureIf",
        When::SuccessIf => "_successIf",
        When::SkipIf => "_skipIf",
        When::While => "_while",
        When::OnSuccess => "_onSuccess",
        When::OnFailure => "_onFailure",
        When::OnHalted => "_onHalted",
        When::Post => "_post",
    }
}

/// Which script an attribute is.
pub(super) fn when_of(attribute: &str) -> Option<When> {
    When::ALL.into_iter().find(|when| attribute_of(*when) == attribute)
}

/// Why `name` cannot name a tree in BehaviorTree.CPP.
pub(super) fn name_fault(name: &str) -> Option<XmlFault> {
    if matches!(name, "" | "Root" | "root") { Some(XmlFault::ReservedName) } else { letter_fault(name) }
}

/// Why `name` cannot name a node in BehaviorTree.CPP.
pub(super) fn node_fault(name: &str) -> Option<XmlFault> {
    let is_element = matches!(name, "BehaviorTree" | "TreeNodesModel" | "include") || class_of(name).is_some();
    if is_element { Some(XmlFault::ReservedName) } else { name_fault(name) }
}

/// Why `name` cannot name a port in BehaviorTree.CPP.
pub(super) fn port_fault(name: &str) -> Option<XmlFault> {
    if matches!(name, "name" | "ID") {
        return Some(XmlFault::ReservedName);
    }
    if !name.starts_with(|first: char| first.is_ascii_alphabetic()) {
        return Some(XmlFault::PortName);
    }
    letter_fault(name)
}

/// The list is `docs/name_validation_rules.md` of BehaviorTree.CPP 4.10.
fn letter_fault(name: &str) -> Option<XmlFault> {
    if name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_') {
        return None;
    }
    let is_forbidden = |letter: &char| letter.is_ascii_control() || " <>&\"'/\\:*?|.".contains(*letter);
    name.chars().find(is_forbidden).map(|letter| XmlFault::ForbiddenLetter { letter })
}

/// Why `title` cannot be an instance name in BehaviorTree.CPP.
pub(super) fn title_fault(title: &str) -> Option<XmlFault> {
    let is_forbidden = |letter: &char| letter.is_ascii_control() && !matches!(letter, '\t' | '\n' | '\r');
    title.chars().find(is_forbidden).map(|letter| XmlFault::ForbiddenLetter { letter })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_sorted_for_binary_search() {
        assert!(BUILT_INS.is_sorted_by_key(|node| node.theirs));
        assert!(BUILT_INS.iter().all(|node| find(node.theirs).is_some_and(|found| found.ours == node.ours)));
    }

    #[track_caller]
    fn check(name: &str, letter: Option<char>) {
        assert_eq!(name_fault(name), letter.map(|letter| XmlFault::ForbiddenLetter { letter }));
    }

    #[test]
    fn letters_of_names() {
        check("open_Door-2", None);
        check("T\u{fc}r", None);
        check("open door", Some(' '));
        check("arm.open", Some('.'));
        check("a/b", Some('/'));
        check("bell\u{7}", Some('\u{7}'));
    }

    #[test]
    fn reserved_names() {
        assert_eq!(name_fault("Root"), Some(XmlFault::ReservedName));
        assert_eq!(name_fault(""), Some(XmlFault::ReservedName));
        assert_eq!(name_fault("BehaviorTree"), None);
        assert_eq!(node_fault("BehaviorTree"), Some(XmlFault::ReservedName));
        assert_eq!(port_fault("ID"), Some(XmlFault::ReservedName));
        assert_eq!(port_fault("2nd"), Some(XmlFault::PortName));
    }
}
