//! Trees in code: one function for each built-in node.
//!
//! ```
//! use sfg_tree::{TreeSpec, nodes::*};
//!
//! let spec = TreeSpec::from(fallback([
//!     retry(3, timeout(20.0, node("grasp").with_key("target", "cup"))).title("try hard"),
//!     sequence([set_blackboard("given_up", true), node("ask_for_help")]),
//! ]));
//! # assert_eq!(spec.root.children.len(), 2);
//! ```
//!
//! A value is a constant or a [`key`]. Ports that are seldom given have no argument: `retry(3, grasp).with("on", vec!["slipped"])`.

use crate::literal::Literal;
use crate::port::Direction;
use crate::spec::{NodeSpec, PortSetting, PortValue, SubtreePort, SubtreeSpec, TreeSpec};

/// A blackboard entry, or with dots a field of one, as the value of a port. `@` before it means the root scope.
pub fn key(key: impl Into<String>) -> PortValue {
    PortValue::Key(key.into())
}

impl<T: Into<Literal>> From<T> for PortValue {
    fn from(value: T) -> Self {
        Self::Literal(value.into())
    }
}

impl From<NodeSpec> for TreeSpec {
    fn from(root: NodeSpec) -> Self {
        Self::new(root)
    }
}

/// A node of the application, such as `node("lift").with("height_m", 0.1)`.
pub fn node(kind: impl Into<String>) -> NodeSpec {
    NodeSpec::new(kind)
}

/// A use of the subtree of this name.
pub fn subtree(name: impl Into<String>) -> NodeSpec {
    NodeSpec::subtree(name)
}

macro_rules! rows {
    ($($(#[$doc:meta])* $kind:ident)*) => { $(
        $(#[$doc])*
        pub fn $kind(children: impl IntoIterator<Item = NodeSpec>) -> NodeSpec {
            NodeSpec::new(stringify!($kind)).children(children)
        }
    )* };
}
rows! {
    /// Does its children one after the other until one fails.
    sequence
    /// A sequence that lets the rest of the tree have a tick after each child done in one call.
    async_sequence
    /// A sequence that begins with the child it failed or was halted at, not with the first.
    sequence_with_memory
    /// Tries its children one after the other until one succeeds.
    fallback
    /// A fallback that lets the rest of the tree have a tick after each child done in one call.
    async_fallback
    /// A sequence that begins with its first child on every tick.
    reactive_sequence
    /// A fallback that begins with its first child on every tick.
    reactive_fallback
    /// Ticks all its children until all have succeeded or one has failed; `success` and `failure` set other numbers.
    parallel
    /// Ticks all its children until each is done; fails if one did, or as many as `max_failures` says.
    parallel_all
}

macro_rules! decorators {
    ($($(#[$doc:meta])* $kind:ident)*) => { $(
        $(#[$doc])*
        #[must_use]
        pub fn $kind(child: NodeSpec) -> NodeSpec {
            NodeSpec::new(stringify!($kind)).child(child)
        }
    )* };
}
decorators! {
    /// Succeeds when its child fails and fails when it succeeds.
    inverter
    /// Succeeds whatever its child does.
    force_success
    /// Fails whatever its child does.
    force_failure
    /// Does its child again and again until it fails.
    keep_running_until_failure
    /// Does its child once in the life of the tree; then it is skipped, or gives the same result with `then_skip` false.
    run_once
}

/// Asks `condition` once, then does `then` when it succeeds and fails when it fails.
#[must_use]
pub fn if_then(condition: NodeSpec, then: NodeSpec) -> NodeSpec {
    NodeSpec::new("if_then_else").children([condition, then])
}

/// Asks `condition` once, then does `then` or `otherwise`.
#[must_use]
pub fn if_then_else(condition: NodeSpec, then: NodeSpec, otherwise: NodeSpec) -> NodeSpec {
    if_then(condition, then).child(otherwise)
}

/// Asks `condition` on every tick, does `then` while it holds and fails when not.
#[must_use]
pub fn while_do(condition: NodeSpec, then: NodeSpec) -> NodeSpec {
    NodeSpec::new("while_do_else").children([condition, then])
}

/// Asks `condition` on every tick and does `then` while it holds, else `otherwise`.
#[must_use]
pub fn while_do_else(condition: NodeSpec, then: NodeSpec, otherwise: NodeSpec) -> NodeSpec {
    while_do(condition, then).child(otherwise)
}

/// Does the node whose case equals `variable`, else `otherwise`; asks on every tick.
pub fn switch<L: Into<Literal>>(
    variable: impl Into<PortValue>,
    cases: impl IntoIterator<Item = (L, NodeSpec)>,
    otherwise: NodeSpec,
) -> NodeSpec {
    let (cases, children): (Vec<Literal>, Vec<NodeSpec>) = cases.into_iter().map(|(case, child)| (case.into(), child)).unzip();
    given("switch", "variable", variable).with("cases", Literal::List(cases)).children(children).child(otherwise)
}

/// Does `steps` as a sequence and, when one fails, `cleanup` before it fails; with `catch_on_halt` when halted, too.
pub fn try_catch(steps: impl IntoIterator<Item = NodeSpec>, cleanup: NodeSpec) -> NodeSpec {
    NodeSpec::new("try_catch").children(steps).child(cleanup)
}

/// Does `child`; when it fails, the node for its reason, and then `child` again, `attempts` times at most. `any` fits every reason.
pub fn recover<R: Into<Literal>>(
    attempts: impl Into<PortValue>,
    child: NodeSpec,
    branches: impl IntoIterator<Item = (R, NodeSpec)>,
) -> NodeSpec {
    let (on, children): (Vec<Literal>, Vec<NodeSpec>) =
        branches.into_iter().map(|(reason, branch)| (reason.into(), branch)).unzip();
    given("recover", "attempts", attempts).with("on", Literal::List(on)).child(child).children(children)
}

/// Tries its child again when it fails, `attempts` times at most or without end when -1; `on` names the reasons to try again for.
pub fn retry(attempts: impl Into<PortValue>, child: NodeSpec) -> NodeSpec {
    given("retry", "attempts", attempts).child(child)
}

/// Does its child again and again, `times` times or without end when -1.
pub fn repeat(times: impl Into<PortValue>, child: NodeSpec) -> NodeSpec {
    given("repeat", "times", times).child(child)
}

/// Halts its child and fails when it takes longer than `secs` seconds.
pub fn timeout(secs: impl Into<PortValue>, child: NodeSpec) -> NodeSpec {
    given("timeout", "secs", secs).child(child)
}

/// Waits `secs` seconds, then does its child.
pub fn delay(secs: impl Into<PortValue>, child: NodeSpec) -> NodeSpec {
    given("delay", "secs", secs).child(child)
}

/// Begins its child at most `hz` times a second, and runs in between.
pub fn rate_limit(hz: impl Into<PortValue>, child: NodeSpec) -> NodeSpec {
    given("rate_limit", "hz", hz).child(child)
}

/// Does its child once for each item of a list or queue; the entry `item` holds the current one.
pub fn loop_over(over: impl Into<PortValue>, item: impl Into<String>, child: NodeSpec) -> NodeSpec {
    given("loop", "over", over).with_key("item", item).child(child)
}

/// Does its child if the condition `script` holds, else gives `else`: `failure` unless set.
pub fn precondition(script: impl Into<String>, child: NodeSpec) -> NodeSpec {
    NodeSpec::new("precondition").with("if", script.into()).child(child)
}

/// Does its child when the entry was written since the last time, else is skipped.
pub fn skip_unless_updated(entry: impl Into<String>, child: NodeSpec) -> NodeSpec {
    NodeSpec::new("skip_unless_updated").with_key("entry", entry).child(child)
}

/// Waits until the entry is written, then does its child.
pub fn wait_value_update(entry: impl Into<String>, child: NodeSpec) -> NodeSpec {
    NodeSpec::new("wait_value_update").with_key("entry", entry).child(child)
}

/// Holds when the entry was written since the last time.
pub fn was_entry_updated(entry: impl Into<String>) -> NodeSpec {
    NodeSpec::new("was_entry_updated").with_key("entry", entry)
}

/// Writes an entry.
pub fn set_blackboard(entry: impl Into<String>, value: impl Into<PortValue>) -> NodeSpec {
    given("set_blackboard", "value", value).with_key("output_key", entry)
}

/// Empties an entry.
pub fn unset_blackboard(entry: impl Into<String>) -> NodeSpec {
    NodeSpec::new("unset_blackboard").with_key("key", entry)
}

/// Calculates with entries: `tries := tries + 1`.
pub fn script(code: impl Into<String>) -> NodeSpec {
    NodeSpec::new("script").with("code", code.into())
}

/// Holds when an expression is true: `tries < 3`.
pub fn script_condition(code: impl Into<String>) -> NodeSpec {
    NodeSpec::new("script_condition").with("code", code.into())
}

/// Does nothing for `secs` seconds.
pub fn sleep(secs: impl Into<PortValue>) -> NodeSpec {
    given("sleep", "secs", secs)
}

/// Succeeds.
#[must_use]
pub fn always_success() -> NodeSpec {
    NodeSpec::new("always_success")
}

/// Fails.
#[must_use]
pub fn always_failure() -> NodeSpec {
    NodeSpec::new("always_failure")
}

fn given(kind: &str, port: &str, value: impl Into<PortValue>) -> NodeSpec {
    let mut node = NodeSpec::new(kind);
    let (name, value) = (port.to_owned(), value.into());
    node.ports.push(PortSetting { name, value, name_location: 0, location: 0 });
    node
}

impl SubtreeSpec {
    /// A subtree without ports that `subtree` nodes call `name`.
    pub fn new(name: impl Into<String>, root: NodeSpec) -> Self {
        Self { name: name.into(), root, ..Self::default() }
    }

    /// Adds a key that it reads.
    #[must_use]
    pub fn input(self, name: impl Into<String>) -> Self {
        self.port(name.into(), Direction::In, None)
    }

    /// Adds a key that it reads and that begins with `default` when the user says nothing.
    #[must_use]
    pub fn input_or(self, name: impl Into<String>, default: impl Into<Literal>) -> Self {
        self.port(name.into(), Direction::In, Some(default.into()))
    }

    /// Adds a key that it writes.
    #[must_use]
    pub fn output(self, name: impl Into<String>) -> Self {
        self.port(name.into(), Direction::Out, None)
    }

    /// Adds a key that it reads and writes.
    #[must_use]
    pub fn inout(self, name: impl Into<String>) -> Self {
        self.port(name.into(), Direction::InOut, None)
    }

    fn port(mut self, name: String, direction: Direction, default: Option<Literal>) -> Self {
        self.ports.push(SubtreePort { name, direction, default, location: 0 });
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::Registry;
    use crate::spec::NodeKind;
    use std::collections::BTreeSet;

    fn ok() -> NodeSpec {
        always_success()
    }

    /// One of each built-in node.
    fn one_of_each() -> Vec<NodeSpec> {
        vec![
            sequence([ok()]),
            async_sequence([ok()]),
            sequence_with_memory([ok()]),
            fallback([ok()]),
            async_fallback([ok()]),
            reactive_sequence([ok()]),
            reactive_fallback([ok()]),
            parallel([ok(), ok()]).with("success", 1),
            parallel_all([ok()]),
            if_then(ok(), ok()),
            if_then_else(ok(), ok(), ok()),
            while_do(ok(), ok()),
            while_do_else(ok(), ok(), ok()),
            switch(key("mode"), [("fast", ok()), ("slow", ok())], ok()),
            try_catch([ok()], ok()),
            recover(3, ok(), [("slipped", ok()), ("any", ok())]),
            inverter(ok()),
            force_success(ok()),
            force_failure(ok()),
            retry(3, ok()).with("on", vec!["slipped"]),
            repeat(key("n"), ok()),
            keep_running_until_failure(ok()),
            timeout(2.5, ok()),
            delay(1, ok()),
            rate_limit(10, ok()),
            run_once(ok()),
            loop_over(vec![1, 2], "item", ok()),
            precondition("n > 1", ok()).with("else", "skipped"),
            skip_unless_updated("n", ok()),
            wait_value_update("n", ok()),
            was_entry_updated("n"),
            set_blackboard("copy", key("n")),
            unset_blackboard("copy"),
            script("n := n + 1"),
            script_condition("n > 1"),
            sleep(0.5),
            always_success(),
            always_failure(),
        ]
    }

    #[test]
    fn every_built_in_node_has_its_function() {
        let registry = Registry::<()>::new();
        let names: BTreeSet<String> = registry.models().iter().map(|model| model.name.to_string()).collect();
        let made: BTreeSet<String> = one_of_each()
            .into_iter()
            .map(|node| match node.kind {
                NodeKind::Named(name) | NodeKind::Subtree(name) => name,
            })
            .collect();
        assert_eq!(made, names);
    }

    #[test]
    fn a_tree_of_them_all_builds() {
        let spec = TreeSpec::from(sequence(one_of_each())).entry("mode", "fast").entry("n", 2);
        let n_nodes = Registry::<()>::new().build(&spec).map(|tree| tree.n_nodes());
        assert_eq!(n_nodes, Ok(1 + 38 + 42));
    }

    #[test]
    fn a_subtree_is_defined_and_used() {
        let double = SubtreeSpec::new("double", script("out := 2 * x; n := n + 1")).input_or("x", 21).output("out").inout("n");
        let users = [subtree("double").with_key("out", "a"), subtree("double").with("x", 4).with_key("out", "b")];
        let spec = TreeSpec::from(sequence(users)).subtree(double).entry("n", 0);
        let mut tree = Registry::<()>::new().build(&spec).map_err(|errors| errors[0].to_string()).expect("the tree is right");
        tree.tick(0.0, &mut ());
        let entries = ["a", "b", "n"].map(|name| tree.literal(name));
        assert_eq!(entries, [42, 8, 2].map(|number: i64| Some(Literal::Int(number))));
    }
}
