//! What a scenario may ask of the judge, and the judge's answer.

use serde::{Deserialize, Serialize};

/// A success condition evaluated on the simulator's truth. In files: `grains_in: {container: bowl, at_least: 0.8}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Predicate {
    /// Share of all grains that lie at rest inside the container.
    GrainsIn {
        /// Object name.
        container: String,
        /// Smallest accepted share, 0 to 1.
        at_least: f64,
    },
    /// Share of all grains that lie neither in the vessel they began in nor in the target.
    SpilledAtMost {
        /// Largest accepted share, 0 to 1.
        fraction: f64,
        /// Object name of the target; without it every vessel of the scene counts as one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        container: Option<String>,
    },
    /// The object is in the hand, at the place in the palm where it was when closing ended.
    StillHeld {
        /// Object name.
        object: String,
        /// Largest displacement in the palm frame, metres.
        within_m: f64,
        /// Largest rotation in the palm frame, degrees.
        within_deg: f64,
    },
    /// The hand has raised the object's centre above its place of rest.
    Lifted {
        /// Object name.
        object: String,
        /// Smallest accepted rise, metres.
        at_least_m: f64,
    },
    /// The hand has carried the object without interruption.
    HeldSecs {
        /// Object name.
        object: String,
        /// Smallest accepted time, seconds.
        at_least_secs: f64,
    },
}

impl Predicate {
    /// The name in files: `grains_in`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::GrainsIn { .. } => "grains_in",
            Self::SpilledAtMost { .. } => "spilled_at_most",
            Self::StillHeld { .. } => "still_held",
            Self::Lifted { .. } => "lifted",
            Self::HeldSecs { .. } => "held_secs",
        }
    }

    /// Names of the objects the predicate speaks about.
    #[must_use]
    pub fn objects(&self) -> Vec<&str> {
        match self {
            Self::GrainsIn { container, .. } => vec![container],
            Self::SpilledAtMost { container, .. } => container.iter().map(String::as_str).collect(),
            Self::StillHeld { object, .. } | Self::Lifted { object, .. } | Self::HeldSecs { object, .. } => vec![object],
        }
    }
}

/// What kind of value an argument takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ArgKind {
    /// The name of an object of the scene.
    ObjectName,
    /// A number in [0, 1].
    Share,
    /// Metres, not negative.
    Metres,
    /// Degrees, not negative.
    Degrees,
    /// Seconds, not negative.
    Seconds,
}

/// One argument of a predicate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ArgSpec {
    /// Key in the file.
    pub name: &'static str,
    /// What it takes.
    pub kind: ArgKind,
    /// Whether it must be given.
    pub required: bool,
}

/// One predicate, for checking a scenario before it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PredicateSpec {
    /// Name in the file.
    pub name: &'static str,
    /// One sentence for the reader of an error message.
    pub meaning: &'static str,
    /// Arguments in the order of the documentation.
    pub args: &'static [ArgSpec],
}

const fn arg(name: &'static str, kind: ArgKind) -> ArgSpec {
    ArgSpec { name, kind, required: true }
}

/// Every truth predicate.
pub const PREDICATES: &[PredicateSpec] = &[
    PredicateSpec {
        name: "grains_in",
        meaning: "share of all grains at rest inside the container",
        args: &[arg("container", ArgKind::ObjectName), arg("at_least", ArgKind::Share)],
    },
    PredicateSpec {
        name: "spilled_at_most",
        meaning: "share of all grains neither in the vessel they began in nor in the target",
        args: &[arg("fraction", ArgKind::Share), ArgSpec { name: "container", kind: ArgKind::ObjectName, required: false }],
    },
    PredicateSpec {
        name: "still_held",
        meaning: "the object is in the hand, where it was when closing ended",
        args: &[arg("object", ArgKind::ObjectName), arg("within_m", ArgKind::Metres), arg("within_deg", ArgKind::Degrees)],
    },
    PredicateSpec {
        name: "lifted",
        meaning: "the hand has raised the object",
        args: &[arg("object", ArgKind::ObjectName), arg("at_least_m", ArgKind::Metres)],
    },
    PredicateSpec {
        name: "held_secs",
        meaning: "the hand has carried the object without interruption",
        args: &[arg("object", ArgKind::ObjectName), arg("at_least_secs", ArgKind::Seconds)],
    },
];

/// One judged number.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Predicate, with the quantity where it has several: `still_held.within_deg`.
    pub name: String,
    /// Measured value; absent when there is nothing to measure (the object was never held).
    pub value: Option<f64>,
    /// What was asked.
    pub threshold: f64,
    /// Whether it holds.
    pub pass: bool,
    /// One sentence with the facts behind it.
    pub detail: String,
}

/// The judge's answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// One entry for each number, in the order asked.
    pub checks: Vec<Check>,
    /// The broken physics invariant, if any: the run then failed whatever the checks say.
    pub physics_tampered: Option<super::Tampering>,
    /// All checks passed (at least one was asked) and physics is intact.
    pub success: bool,
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[track_caller]
    fn check(yaml: &str, name: &str) {
        let predicate: Predicate = serde_saphyr::from_str(yaml).unwrap();
        assert_eq!(predicate.name(), name);
        let spec = PREDICATES.iter().find(|spec| spec.name == name).unwrap();
        let json = serde_json::to_value(&predicate).unwrap();
        let given: Vec<&String> = json[name].as_object().unwrap().keys().collect();
        for arg in spec.args.iter().filter(|arg| arg.required) {
            assert!(given.iter().any(|key| *key == arg.name), "{name} needs {}", arg.name);
        }
        assert!(given.iter().all(|key| spec.args.iter().any(|arg| arg.name == *key)));
    }

    #[test]
    fn the_argument_table_agrees_with_the_parser() {
        check("grains_in: {container: bowl, at_least: 0.8}", "grains_in");
        check("spilled_at_most: {fraction: 0.1}", "spilled_at_most");
        check("spilled_at_most: {fraction: 0.1, container: bowl}", "spilled_at_most");
        check("still_held: {object: bottle, within_m: 0.05, within_deg: 15}", "still_held");
        check("lifted: {object: bottle, at_least_m: 0.1}", "lifted");
        check("held_secs: {object: bottle, at_least_secs: 2}", "held_secs");
        assert!(serde_saphyr::from_str::<Predicate>("lifted: {object: bottle, at_least_m: 0.1, soft: true}").is_err());
        assert!(serde_saphyr::from_str::<Predicate>("grains_in: {container: bowl}").is_err());
    }
}
