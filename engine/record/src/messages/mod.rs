//! Our own messages in `run.mcap`: JSON, each with the JSON schema of its struct.
//!
//! Names are stable: a changed layout gets a new number. Points are `[x, y, z]` in metres and poses [`PoseLayout`](sfg_types::layout::PoseLayout), in the frame
//! of the base link unless the field's name says otherwise; pixels count from the upper left.

mod decision;
mod header;
mod motion;
mod tree;

pub use decision::{
    CandidateEntry, Candidates, Functionality, Inventory, KeyPoint, MaskView, Masks, Rejection, Stage, Verdict, runs_of,
};
pub use header::{
    CameraHeader, GraspTypeHeader, JointHeader, JointSourceHeader, LinkHeader, MeshHeader, ObjectHeader, RunHeader, ShapeHeader,
    SynergyHeader, TableHeader,
};
pub use motion::{Contact, MotorSample, RobotSample, SynergySample, TruthSample};
pub use tree::{JournalTick, NodeHeader, PortHeader, Transition, TreeDefinition, Write};

use schemars::JsonSchema;
use serde::Serialize;

/// A message of a channel of our own.
pub trait Message: Serialize + JsonSchema {
    /// The channel.
    const TOPIC: &'static str;
    /// Name and version of the layout: `sfg.<Name>.v<number>`.
    const SCHEMA: &'static str;
}

macro_rules! message {
    ($($name:ident $(<$life:lifetime>)? $topic:literal $schema:literal;)*) => {
        $(impl Message for $name $(<$life>)? {
            const TOPIC: &'static str = $topic;
            const SCHEMA: &'static str = $schema;
        })*

        /// Topic and schema name of every channel of our own.
        pub const CHANNELS: &[(&str, &str)] = &[$(($topic, $schema)),*];
    };
}

message! {
    RunHeader "/run" "sfg.Run.v1";
    TreeDefinition "/tree/definition" "sfg.TreeDefinition.v1";
    Transition "/tree" "sfg.Transition.v1";
    JournalTick "/journal" "sfg.Journal.v1";
    Write "/blackboard" "sfg.Write.v1";
    Stage<'_> "/stages" "sfg.Stage.v1";
    Functionality<'_> "/functionality" "sfg.Functionality.v1";
    Inventory<'_> "/inventory" "sfg.Inventory.v1";
    Masks "/masks" "sfg.Masks.v1";
    KeyPoint "/key_point" "sfg.KeyPoint.v1";
    Candidates<'_> "/candidates" "sfg.Candidates.v1";
    RobotSample<'_> "/robot" "sfg.RobotSample.v1";
    SynergySample "/synergy" "sfg.Synergy.v1";
    MotorSample "/motors" "sfg.Motors.v1";
    TruthSample "/truth" "sfg.Truth.v1";
    Verdict<'_> "/verdict" "sfg.Verdict.v1";
}

/// Nanoseconds on the driver's clock.
pub(crate) fn nanos(stamp_secs: f64) -> u64 {
    (stamp_secs.max(0.0) * 1e9).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_named_once_and_carry_their_version() {
        for (idx, (topic, schema)) in CHANNELS.iter().enumerate() {
            assert!(CHANNELS[..idx].iter().all(|(other, name)| other != topic && name != schema), "{topic} {schema}");
            assert!(schema.starts_with("sfg.") && schema.ends_with(".v1"), "{schema}");
        }
    }
}
