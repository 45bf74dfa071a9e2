//! What built-in nodes and their ports are called in BehaviorTree.CPP 4.

use crate::xml::{Kind, find_ours, type_label};

/// How the value of a port is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// As it is.
    Plain,
    /// Seconds as whole milliseconds.
    Millis,
}

/// The name of a node kind. Kinds of the application, and built-in ones that BehaviorTree.CPP lacks, keep theirs; a `switch`
/// and a `loop` have several names there, see [`switch`] and [`LOOPS`].
pub(super) fn kind(ours: &str) -> &str {
    if ["switch", "loop"].contains(&ours) {
        return ours;
    }
    find_ours(ours).map_or(ours, |node| node.theirs)
}

/// The name of a port, and how its value is written.
pub(super) fn port<'a>(kind: &str, ours: &'a str) -> (&'a str, Form) {
    let port = find_ours(kind).and_then(|node| node.ports.iter().find(|port| port.ours == ours));
    match port {
        Some(port) if port.kind == Kind::Millis => (port.theirs, Form::Millis),
        Some(port) => (port.theirs, Form::Plain),
        None => (ours, Form::Plain),
    }
}

/// Most cases that a switch of BehaviorTree.CPP has.
pub(super) const SWITCH_CASES: std::ops::RangeInclusive<usize> = 2..=6;

/// The name of a switch with so many cases.
pub(super) fn switch(n_cases: usize) -> String {
    if SWITCH_CASES.contains(&n_cases) { format!("Switch{n_cases}") } else { "switch".to_owned() }
}

/// Loops by the type of their items.
pub(super) const LOOPS: [(&str, &str); 4] =
    [("LoopBool", "bool"), ("LoopDouble", "f64"), ("LoopInt", "i32"), ("LoopString", "String")];

/// The name of a type as editors show it; types that C++ does not have keep theirs.
pub(super) fn type_name(ours: &str) -> String {
    match ours {
        "Status" => "BT::NodeStatus".to_owned(),
        "any" | "Literal" => "BT::AnyTypeAllowed".to_owned(),
        _ => type_label(ours),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::Registry;

    /// So that a built-in node added later is not forgotten here.
    #[test]
    fn every_built_in_node_has_a_name_there_but_these() {
        let registry = Registry::<()>::new();
        let same: Vec<&str> = registry.models().iter().map(|model| &*model.name).filter(|name| kind(name) == *name).collect();
        assert_eq!(same, ["switch", "recover", "loop"]);
    }

    #[test]
    fn types_are_named_as_in_cpp() {
        assert_eq!(type_name("Vec<f64>"), "std::vector<double>");
        assert_eq!(type_name("PalmPose"), "PalmPose");
    }
}
