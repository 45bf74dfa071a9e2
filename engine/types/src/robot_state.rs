//! What a driver accepts and returns each control period.

use crate::{HandSide, SynergyCoordinates};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Command to a two-motor synergy hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HandCommand {
    /// First synergy, [0, 1]: `synergy` of the SoftHand2 driver.
    pub synergy: f64,
    /// Second synergy, [-1, 1]: `manipulation` of the SoftHand2 driver.
    pub manipulation: f64,
}

impl From<SynergyCoordinates> for HandCommand {
    fn from(c: SynergyCoordinates) -> Self {
        let c = c.clamped();
        Self { synergy: c.c1, manipulation: c.c2 }
    }
}

/// All that a SoftHand2 tells: it has no joint sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HandFeedback {
    /// Motor positions in units of the commands: `m1 = synergy + manipulation`, `m2 = synergy - manipulation` when nothing blocks.
    pub motor_positions: [f64; 2],
    /// Motor currents, amperes; they grow with tendon tension.
    pub motor_currents_amps: [f64; 2],
}

/// One control period's set point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RobotCommand {
    /// Which arm and hand.
    pub side: HandSide,
    /// Joint positions to be reached at the end of the period, radians.
    pub q: Vec<f64>,
    /// Joint velocities at that moment, rad/s.
    pub dq: Vec<f64>,
    /// Hand set point.
    pub hand: HandCommand,
}

/// One control period's measurement.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobotState {
    /// Time on the driver's clock.
    pub stamp_secs: f64,
    /// Which arm and hand the rest is about.
    pub side: HandSide,
    /// Measured joint positions, radians.
    pub q: Vec<f64>,
    /// Measured joint velocities, rad/s.
    pub dq: Vec<f64>,
    /// Hand motors.
    pub hand: HandFeedback,
}
