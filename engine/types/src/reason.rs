//! The closed list of failure reasons a tree can decide on.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

macro_rules! reasons {
    ($($variant:ident $name:literal $doc:literal;)*) => {
        /// Why a stage failed. Scenarios name these in `retry: {on: [...]}`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
        #[serde(rename_all = "snake_case")]
        pub enum FailureReason { $(#[doc = $doc] $variant,)* }

        impl FailureReason {
            /// Every reason.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// The name in files: `no_view`.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// What it means, in one sentence.
            #[must_use]
            pub fn meaning(self) -> &'static str {
                match self { $(Self::$variant => $doc,)* }
            }
        }
    };
}

reasons! {
    NoView "no_view" "The cameras returned no image, or one without any depth.";
    NothingOnTable "nothing_on_table" "No object was found on the table.";
    NeedsAnswer "needs_answer" "The instruction leaves a choice open that only the user can make.";
    Refused "refused" "The instruction cannot or must not be carried out.";
    InvalidFunctionality "invalid_functionality" "The language backend's answer is outside the taxonomy or names nothing in the scene.";
    PartNotFound "part_not_found" "The part to hold was not found in any view.";
    NoDepth "no_depth" "The part was found but has no depth.";
    NoCandidate "no_candidate" "No palm pose was proposed.";
    NoCandidateReachable "no_candidate_reachable" "Palm poses were proposed, none can be reached and used for the task.";
    NoPath "no_path" "No collision-free motion was found.";
    TrackingLost "tracking_lost" "The arm did not follow its commands within tolerance.";
    GraspEmpty "grasp_empty" "The hand closed without meeting the object.";
    LiftFailed "lift_failed" "The object did not come up with the hand.";
    Slipped "slipped" "The object moved in the hand or was lost.";
    TargetNotFound "target_not_found" "The object the task acts on is not in the scene.";
    NothingPoured "nothing_poured" "The full tilt was reached and the target did not fill.";
    Timeout "timeout" "The time given in the scenario was used up.";
    LimitViolated "limit_violated" "A command was so far outside the joint, speed, workspace or distance limits that little of it was left; the engine brought the arm to rest.";
    EmergencyStop "emergency_stop" "The emergency stop was requested.";
    PluginFailed "plugin_failed" "A plugin returned an error.";
    DriverFailed "driver_failed" "The driver returned an error.";
}

/// A word that names no reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown failure reason {0:?}")]
pub struct UnknownReason(pub String);

impl fmt::Display for FailureReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for FailureReason {
    type Err = UnknownReason;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.iter().copied().find(|reason| reason.name() == text).ok_or_else(|| UnknownReason(text.to_owned()))
    }
}
