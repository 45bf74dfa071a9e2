//! The nodes that every registry has, in the order of their documentation.

use crate::literal::{FromLiteral, Literal, Shape};
use crate::port::{Direction, PortSpec};
use crate::registry::{NodeClass, NodeModel};
use crate::status::Status;
use crate::tree::Kind;

/// How many children a kind takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Children {
    None,
    One,
    AtLeast(usize),
    TwoOrThree,
    /// One more than the items of port 1.
    OneMoreThanCases,
    /// One more than the items of port 1, the first being the one that is done.
    OneMoreThanReasons,
}

/// A built-in node kind.
pub(crate) struct BuiltIn {
    pub(crate) kind: Kind,
    pub(crate) children: Children,
    pub(crate) model: NodeModel,
}

fn secs(doc: &'static str) -> PortSpec {
    PortSpec::setting::<f64>("secs").range(0.0, f64::INFINITY).doc(doc)
}

/// `success`, `failure`, `skipped` or `running`.
fn result(name: &'static str, default: &'static str, doc: &'static str) -> PortSpec {
    const RESULTS: [Status; 4] = [Status::Success, Status::Failure, Status::Skipped, Status::Running];
    let shape = Shape::OneOf(RESULTS.iter().map(|status| status.name().to_owned()).collect());
    PortSpec::setting_with::<Status>(name, shape, |literal| {
        let found = RESULTS.into_iter().find(|status| matches!(literal, Literal::Text(word) if word == status.name()));
        found.ok_or_else(|| format!("expected one of success, failure, skipped, running, found {literal}"))
    })
    .default_value(default)
    .doc(doc)
}

/// A number of rounds.
fn rounds(name: &'static str, doc: &'static str) -> PortSpec {
    PortSpec::setting_with::<i32>(name, Shape::Int, |literal| match i32::from_literal(literal)? {
        -1 => Ok(-1),
        n if n >= 1 => Ok(n),
        n => Err(format!("expected at least 1, or -1 for no end, found {n}")),
    })
    .doc(doc)
}

fn script(name: &'static str, doc: &'static str) -> PortSpec {
    PortSpec::setting::<String>(name).doc(doc)
}

#[expect(clippy::too_many_lines, reason = "a table")]
pub(crate) fn built_in() -> Vec<BuiltIn> {
    use Children::{AtLeast, One, OneMoreThanCases, OneMoreThanReasons, TwoOrThree};
    use Direction::{In, Out};
    let row = |kind, name: &'static str, class, children, ports, doc: &'static str| BuiltIn {
        kind,
        children,
        model: NodeModel::new(name, class, ports).with_doc(doc),
    };
    let control = |kind, name, children, ports, doc| row(kind, name, NodeClass::Control, children, ports, doc);
    let decorator = |kind, name, ports, doc| row(kind, name, NodeClass::Decorator, One, ports, doc);
    let leaf = |kind, name, class, ports, doc| row(kind, name, class, Children::None, ports, doc);
    let any = AtLeast(1);
    let count = |name: &'static str, doc: &'static str| PortSpec::setting::<i32>(name).doc(doc);
    vec![
        control(Kind::Sequence, "sequence", any, vec![], "Does its children one after the other until one fails."),
        control(
            Kind::AsyncSequence,
            "async_sequence",
            any,
            vec![],
            "A sequence that lets the rest of the tree have a tick after each child done in one call.",
        ),
        control(
            Kind::SequenceWithMemory,
            "sequence_with_memory",
            any,
            vec![],
            "A sequence that begins with the child it failed or was halted at, not with the first.",
        ),
        control(Kind::Fallback, "fallback", any, vec![], "Tries its children one after the other until one succeeds."),
        control(
            Kind::AsyncFallback,
            "async_fallback",
            any,
            vec![],
            "A fallback that lets the rest of the tree have a tick after each child done in one call.",
        ),
        control(
            Kind::ReactiveSequence,
            "reactive_sequence",
            any,
            vec![],
            "A sequence that begins with its first child on every tick.",
        ),
        control(
            Kind::ReactiveFallback,
            "reactive_fallback",
            any,
            vec![],
            "A fallback that begins with its first child on every tick.",
        ),
        control(
            Kind::Parallel,
            "parallel",
            any,
            vec![
                count("success", "Successes needed; a negative number counts from the end: -1 is all.").default_value(-1),
                count("failure", "Failures accepted as the end; a negative number counts from the end.").default_value(1),
            ],
            "Ticks all its children on every tick until enough have succeeded or failed.",
        ),
        control(
            Kind::ParallelAll,
            "parallel_all",
            any,
            vec![count("max_failures", "Failures that make it fail; a negative number counts from the end.").default_value(1)],
            "Ticks all its children until each is done.",
        ),
        control(
            Kind::IfThenElse,
            "if_then_else",
            TwoOrThree,
            vec![],
            "Asks its first child once, then does the second or the third.",
        ),
        control(
            Kind::WhileDoElse,
            "while_do_else",
            TwoOrThree,
            vec![],
            "Asks its first child on every tick and does the second while it holds, else the third.",
        ),
        control(
            Kind::Switch,
            "switch",
            OneMoreThanCases,
            vec![
                PortSpec::any_setting("variable").optional().doc("What is compared; usually a key."),
                PortSpec::setting::<Vec<Literal>>("cases").doc("One value for each child but the last, which is the default."),
            ],
            "Does the child whose case is the value, else the last one; asks on every tick.",
        ),
        control(
            Kind::TryCatch,
            "try_catch",
            AtLeast(2),
            vec![PortSpec::setting::<bool>("catch_on_halt").default_value(false).doc("Whether to clean up when halted, too.")],
            "A sequence of all children but the last, which cleans up when one of them fails.",
        ),
        control(
            Kind::Recover,
            "recover",
            OneMoreThanReasons,
            vec![
                PortSpec::setting::<u32>("attempts").range(1.0, f64::INFINITY).doc("How often the first child is tried."),
                PortSpec::setting::<Vec<String>>("on").doc("One reason for each further child; `any` fits every reason."),
            ],
            "Does its first child; when that fails, the child for the reason, and then the first again.",
        ),
        decorator(Kind::Inverter, "inverter", vec![], "Succeeds when its child fails and fails when it succeeds."),
        decorator(Kind::ForceSuccess, "force_success", vec![], "Succeeds whatever its child does."),
        decorator(Kind::ForceFailure, "force_failure", vec![], "Fails whatever its child does."),
        decorator(
            Kind::Retry,
            "retry",
            vec![
                rounds("attempts", "How often the child is tried; -1 without end."),
                PortSpec::setting::<Vec<String>>("on")
                    .default_value(Literal::List(vec![]))
                    .doc("Reasons to try again; any when empty."),
            ],
            "Tries its child again when it fails.",
        ),
        decorator(
            Kind::Repeat,
            "repeat",
            vec![rounds("times", "Rounds; without end when -1 or not given.").default_value(-1)],
            "Does its child again and again.",
        ),
        decorator(Kind::KeepRunning, "keep_running_until_failure", vec![], "Does its child again and again until it fails."),
        decorator(
            Kind::Timeout,
            "timeout",
            vec![PortSpec::setting::<f64>("secs").range(0.001, f64::INFINITY).doc("Time for the child, seconds.")],
            "Halts its child and fails when it takes too long.",
        ),
        decorator(Kind::Delay, "delay", vec![secs("Time before the child begins, seconds.")], "Waits, then does its child."),
        decorator(
            Kind::RateLimit,
            "rate_limit",
            vec![PortSpec::setting::<f64>("hz").range(0.001, 1e6).doc("How often a second the child begins at most.")],
            "Begins its child at most so often, and runs in between.",
        ),
        decorator(
            Kind::RunOnce,
            "run_once",
            vec![
                PortSpec::setting::<bool>("then_skip")
                    .default_value(true)
                    .doc("Whether it is skipped once it is done, instead of giving the same result."),
            ],
            "Does its child once in the life of the tree.",
        ),
        decorator(
            Kind::Loop,
            "loop",
            vec![
                PortSpec::any_setting("over").doc("A list, or a queue that others fill."),
                PortSpec::any_key("item", Out).default_key("item").doc("Key that holds the current item."),
                result("if_empty", "success", "Result when nothing is left."),
            ],
            "Does its child once for each item.",
        ),
        decorator(
            Kind::Precondition,
            "precondition",
            vec![
                script("if", "Condition that must hold before the child begins."),
                result("else", "failure", "Result when it does not hold."),
            ],
            "Does its child if a condition holds.",
        ),
        decorator(
            Kind::SkipUnlessUpdated,
            "skip_unless_updated",
            vec![PortSpec::any_key("entry", In).optional().doc("Key that must have been written since the last time.")],
            "Does its child when an entry was written, else is skipped.",
        ),
        decorator(
            Kind::WaitValueUpdate,
            "wait_value_update",
            vec![PortSpec::any_key("entry", In).optional().doc("Key that must have been written since the last time.")],
            "Waits until an entry is written, then does its child.",
        ),
        leaf(
            Kind::WasEntryUpdated,
            "was_entry_updated",
            NodeClass::Condition,
            vec![PortSpec::any_key("entry", In).optional().doc("Key that must have been written since the last time.")],
            "Holds when an entry was written since the last time.",
        ),
        leaf(
            Kind::SetBlackboard,
            "set_blackboard",
            NodeClass::Step,
            vec![
                PortSpec::any_setting("value").doc("A literal, or the key to copy from."),
                PortSpec::any_key("output_key", Out).doc("Key that is written."),
            ],
            "Writes an entry.",
        ),
        leaf(
            Kind::UnsetBlackboard,
            "unset_blackboard",
            NodeClass::Step,
            vec![PortSpec::any_key("key", Out).doc("Key that is emptied.")],
            "Empties an entry.",
        ),
        leaf(
            Kind::Script,
            "script",
            NodeClass::Step,
            vec![script("code", "Statements such as `tries := tries + 1`, separated by `;`.")],
            "Calculates with entries.",
        ),
        leaf(
            Kind::ScriptCondition,
            "script_condition",
            NodeClass::Condition,
            vec![script("code", "An expression such as `tries < 3`.")],
            "Holds when an expression is true.",
        ),
        leaf(Kind::Sleep, "sleep", NodeClass::Action, vec![secs("Time, seconds.")], "Does nothing for a while."),
        leaf(Kind::AlwaysSuccess, "always_success", NodeClass::Step, vec![], "Succeeds."),
        leaf(Kind::AlwaysFailure, "always_failure", NodeClass::Step, vec![], "Fails."),
    ]
}
