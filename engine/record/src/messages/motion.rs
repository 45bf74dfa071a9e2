//! What moves: the robot as measured and commanded, and in the simulator the truth.

use schemars::JsonSchema;
use serde::Serialize;
use sfg_types::layout::PoseLayout;
use sfg_types::{HandCommand, RobotState};

/// `/robot`, 100 Hz: what was measured and what was asked for.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct RobotSample<'a> {
    /// Measurement.
    #[serde(flatten)]
    pub state: &'a RobotState,
    /// Commanded joint positions, radians.
    pub q_command: &'a [f64],
    /// Hand set point.
    pub hand_command: HandCommand,
}

/// `/synergy`, 30 Hz: the hand in its synergy plane, flat for plotting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct SynergySample {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// Measured closure, 0 to 1.
    pub c1: f64,
    /// Measured refinement, -1 to 1.
    pub c2: f64,
    /// Commanded closure.
    pub c1_command: f64,
    /// Commanded refinement.
    pub c2_command: f64,
}

/// `/motors`, 30 Hz: the hand's motors, flat for plotting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MotorSample {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// First motor, units of the commands.
    pub position_1: f64,
    /// Second motor.
    pub position_2: f64,
    /// Current of the first.
    pub current_1_amps: f64,
    /// Current of the second.
    pub current_2_amps: f64,
}

/// `/truth`, 30 Hz, simulator alone: for viewers and the judge, never for skills.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct TruthSample {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// Poses of the objects, in the order of `/run`.
    pub objects: Vec<PoseLayout>,
    /// Joints of the acting hand, radians, in the order of `/run`'s `hand_q`.
    pub hand_q: Vec<f64>,
    /// Centres of the grains, millimetre grid, at most 10 Hz; absent while they are where they were, for up to 1 s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grains: Option<Vec<[f64; 3]>>,
    /// What touches the objects; grains left out.
    pub contacts: Vec<Contact>,
}

/// A contact of an object.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Contact {
    /// Name of the object.
    pub object: String,
    /// What touches it: a hand link, `table`, `robot` or another object.
    pub with: String,
    /// Impulse of the last step, Ns.
    pub impulse_ns: f64,
    /// Middle of where they press on each other, 0.1 mm grid; absent in older recordings.
    pub point_in_base: [f64; 3],
}
