//! The SoftHand2 as its motors see it: two commands pull one tendon over all fingers, springs pull back, blocked fingers stay.
//!
//! Law (Catalano et al., IJRR 33(5) 2014; Della Santina et al., T-RO 2018): `tau = R1 u1 + R2 u2 - E q`. `u1` is the tension
//! both motors share, `u2` the difference that friction at the pulleys leaves between thumb and little finger when the motors
//! move apart. For one step the tensions are constant, and then the law IS a position servo of stiffness `E_j` towards
//! `(R1_j u1 + R2_j u2) / E_j`; so rapier solves it implicitly. Tensions follow from tendon stretch once per step,
//! `u_k = k_t (s_k - sigma_k(q))` with `sigma_k = R_k q / |R_k|^2` the tendon drawn in.
//!
//! `s_k(c)` is calibrated such that the free hand reaches exactly `u = clip(M c, 0, 1)` (equations 12 and 13). A blocked joint
//! leaves more stretch, hence more tension, and the others go on; the second tension helps whichever end of the hand is
//! blocked, which is what lets one thumb oppose four fingers. The explicit once-per-step tension is stable since
//! `dt k_t / damping` is small (0.27 with the shipped profile).

use crate::error::WorldError;
use crate::multibody::{Articulation, Servo};
use rapier3d::prelude::PhysicsWorld;
use sfg_types::{HandCommand, HandFeedback, HandJoint, HandProfile, SynergyCoordinates};

/// Motors, tendon and springs, without any physics engine: joint positions in, servo set points out.
#[derive(Clone, Debug)]
pub struct TendonDrive {
    joints: Vec<HandJoint>,
    /// For each joint its row of `M`, or `None` for a joint that `M` does not drive.
    rows: Vec<Option<[f64; 2]>>,
    tendon_stiffness: f64,
    max_tension: f64,
    max_current_amps: f64,
    max_speed: f64,
    /// Where the motors are, as synergy coordinates.
    motors: SynergyCoordinates,
    tensions: [f64; 2],
}

impl TendonDrive {
    /// The drive of a hand whose motors stand at the open hand.
    ///
    /// # Errors
    /// [`WorldError::Robot`] when `M` has not one row per synergy joint, a synergy joint does not exist, or no joint
    /// takes part in one of the tensions.
    pub fn new(profile: &HandProfile) -> Result<Self, WorldError> {
        let broken = |message: String| WorldError::Robot { message: format!("hand profile {:?}: {message}", profile.name) };
        if profile.synergy_joints.len() != profile.synergy_matrix.len() {
            let (n_joints, n_rows) = (profile.synergy_joints.len(), profile.synergy_matrix.len());
            return Err(broken(format!("{n_joints} synergy joints, but the synergy matrix has {n_rows} rows")));
        }
        if let Some(lost) = profile.synergy_joints.iter().find(|n| !profile.joints.iter().any(|j| j.name == **n)) {
            return Err(broken(format!("synergy joint {lost:?} is not among the joints")));
        }
        let row_of = |joint: &HandJoint| {
            let idx = profile.synergy_joints.iter().position(|n| *n == joint.name)?;
            Some(profile.synergy_matrix[idx])
        };
        let drive = Self {
            rows: profile.joints.iter().map(row_of).collect(),
            joints: profile.joints.clone(),
            tendon_stiffness: profile.tendon_stiffness_nm_per_rad,
            max_tension: profile.max_tension_nm,
            max_current_amps: profile.max_current_amps,
            max_speed: profile.max_closing_speed_per_sec,
            motors: SynergyCoordinates::OPEN,
            tensions: [0.0; 2],
        };
        if (0..2).any(|k| drive.ratio_norm_squared(k) <= 0.0) {
            return Err(broken("closing ratios or shifting ratios are all zero".to_owned()));
        }
        Ok(drive)
    }

    /// The drive with its motors already at `c`, for scenes that start with a preshaped hand.
    #[must_use]
    pub fn starting_at(mut self, c: SynergyCoordinates) -> Self {
        self.motors = c.clamped();
        self.tensions = self.tensions_at(self.motors, &self.free_joints(self.motors));
        self
    }

    /// One control period: motors run towards `command` at their speed limit and stall at the largest tension.
    ///
    /// # Panics
    /// If `q` has not one position for each joint of the profile.
    pub fn step(&mut self, command: HandCommand, q: &[f64], dt_secs: f64) {
        assert_eq!(q.len(), self.joints.len(), "one position for each joint of the profile");
        let goal = SynergyCoordinates::new(command.synergy, command.manipulation).clamped();
        let reach = self.max_speed * dt_secs;
        let step = SynergyCoordinates::new(
            (goal.c1 - self.motors.c1).clamp(-reach, reach),
            (goal.c2 - self.motors.c2).clamp(-reach, reach),
        );
        let moved = SynergyCoordinates::new(self.motors.c1 + step.c1, self.motors.c2 + step.c2);
        let (before, after) = (self.tensions_at(self.motors, q), self.tensions_at(moved, q));
        // A motor at its stall force cannot pull further, but it can always let go.
        let stalls = motor_load(after) > self.max_tension && motor_load(after) > motor_load(before);
        if !stalls {
            self.motors = moved;
        }
        let pulled = if stalls { before } else { after };
        let cut = (self.max_tension / motor_load(pulled).max(f64::MIN_POSITIVE)).min(1.0);
        self.tensions = pulled.map(|u| u * cut);
    }

    /// `[u1, u2]` as joint torque at ratio 1, Nm.
    #[must_use]
    pub fn tensions_nm(&self) -> [f64; 2] {
        self.tensions
    }

    /// The servo that stands for tendon and spring of one joint during the next step.
    #[must_use]
    pub fn servo(&self, joint_idx: usize) -> Servo {
        let joint = &self.joints[joint_idx];
        let pull = joint.closing_ratio * self.tensions[0] + joint.shifting_ratio * self.tensions[1];
        // A tendon cannot push: a flexion with negative pull is opened by its spring alone. Abductions are pulled both ways.
        let pull = if joint.closing_ratio > 0.0 && joint.lower_rad >= 0.0 { pull.max(0.0) } else { pull };
        Servo {
            position: pull / joint.stiffness_nm_per_rad,
            velocity: 0.0,
            kp: joint.stiffness_nm_per_rad,
            kd: joint.damping_nms_per_rad,
            max_effort: joint.max_torque_nm,
        }
    }

    /// What the real hand tells: motor positions in command units and currents in proportion to each motor's tension.
    #[must_use]
    pub fn feedback(&self) -> HandFeedback {
        let amps = |tension: f64| (tension.abs() / self.max_tension).min(1.0) * self.max_current_amps;
        HandFeedback {
            motor_positions: [self.motors.c1 + self.motors.c2, self.motors.c1 - self.motors.c2],
            motor_currents_amps: [amps(self.tensions[0] + self.tensions[1]), amps(self.tensions[0] - self.tensions[1])],
        }
    }

    /// Joint positions of the free hand at `c`, in profile order: `clip(M c, 0, 1)` between the limits, other joints where
    /// their share of the first tension pulls them.
    #[must_use]
    pub fn free_joints(&self, c: SynergyCoordinates) -> Vec<f64> {
        let [u1, _] = self.free_tensions(c);
        let free = |(joint, row): (&HandJoint, &Option<[f64; 2]>)| match row {
            Some([m1, m2]) => {
                let closure = (m1 * c.c1 + m2 * c.c2).clamp(0.0, 1.0);
                joint.lower_rad + closure * (joint.upper_rad - joint.lower_rad)
            }
            None => (joint.closing_ratio * u1 / joint.stiffness_nm_per_rad).clamp(joint.lower_rad, joint.upper_rad),
        };
        self.joints.iter().zip(&self.rows).map(free).collect()
    }

    /// Tensions that hold the free hand at `c`: those of a joint with ratio 1 moved through its full range by one unit.
    fn free_tensions(&self, c: SynergyCoordinates) -> [f64; 2] {
        let driven = self.joints.iter().zip(&self.rows).filter(|(j, row)| row.is_some() && j.closing_ratio != 0.0);
        let per_unit = |(joint, _): (&HandJoint, &Option<[f64; 2]>)| {
            joint.stiffness_nm_per_rad * (joint.upper_rad - joint.lower_rad) / joint.closing_ratio
        };
        let (sum, n) = driven.map(per_unit).fold((0.0, 0.0), |(sum, n), x| (sum + x, n + 1.0));
        let unit: f64 = if n > 0.0 { sum / n } else { 0.0 };
        [unit * c.c1, unit * c.c2]
    }

    /// Tensions at motor position `c` when the joints are at `q`.
    fn tensions_at(&self, c: SynergyCoordinates, q: &[f64]) -> [f64; 2] {
        let (free_u, free_q) = (self.free_tensions(c), self.free_joints(c));
        let stretch = |k: usize| self.drawn_in(k, &free_q) - self.drawn_in(k, q);
        // The tendon goes slack rather than pushing.
        [(free_u[0] + self.tendon_stiffness * stretch(0)).max(0.0), free_u[1] + self.tendon_stiffness * stretch(1)]
    }

    /// `sigma_k`: how much of tendon direction `k` the joints have drawn in, radians of a joint with ratio 1.
    fn drawn_in(&self, k: usize, q: &[f64]) -> f64 {
        let length: f64 = self.joints.iter().zip(q).map(|(joint, q)| ratio(joint, k) * q).sum();
        length / self.ratio_norm_squared(k)
    }

    fn ratio_norm_squared(&self, k: usize) -> f64 {
        self.joints.iter().map(|joint| ratio(joint, k).powi(2)).sum()
    }
}

/// The drive bound to a hand in a physics world.
#[derive(Clone, Debug)]
pub struct SimulatedHand {
    drive: TendonDrive,
    /// For each joint of the profile its index in the articulation.
    joint_idx: Vec<usize>,
}

impl SimulatedHand {
    /// Binds the profile's joints to those of `articulation` that carry `prefix` (`left_`, or nothing for a hand alone).
    ///
    /// # Errors
    /// [`WorldError::Robot`] for a profile that does not fit the articulation.
    pub fn new(profile: &HandProfile, articulation: &Articulation, prefix: &str) -> Result<Self, WorldError> {
        let joint_idx = profile.joints.iter().map(|joint| articulation.joint_idx(&format!("{prefix}{}", joint.name)));
        Ok(Self { drive: TendonDrive::new(profile)?, joint_idx: joint_idx.collect::<Result<_, _>>()? })
    }

    /// Puts fingers and motors at the free posture of `c`, at rest.
    pub fn reset(&mut self, world: &mut PhysicsWorld, articulation: &Articulation, c: SynergyCoordinates) {
        self.drive = self.drive.clone().starting_at(c);
        let mut q = articulation.q(world);
        for (idx, hand_q) in self.joint_idx.iter().zip(self.drive.free_joints(c.clamped())) {
            q[*idx] = hand_q;
        }
        articulation.teleport(world, &q);
    }

    /// Moves the motors by one step of `world` and sets the finger servos; call it before each step.
    pub fn step(&mut self, world: &mut PhysicsWorld, articulation: &Articulation, command: HandCommand) {
        let q = self.hand_q(world, articulation);
        self.drive.step(command, &q, f64::from(world.integration_parameters.dt));
        for (nth, idx) in self.joint_idx.iter().enumerate() {
            articulation.set_servo(world, *idx, &self.drive.servo(nth));
        }
    }

    /// Motor positions and currents.
    #[must_use]
    pub fn feedback(&self) -> HandFeedback {
        self.drive.feedback()
    }

    /// Finger positions in profile order, for judge and viewer only: the real hand has no joint sensors.
    #[must_use]
    pub fn hand_q(&self, world: &PhysicsWorld, articulation: &Articulation) -> Vec<f64> {
        let q = articulation.q(world);
        self.joint_idx.iter().map(|idx| q[*idx]).collect()
    }

    /// Torque of tendon, spring and damping at each joint, profile order, Nm; for the judge's limits.
    #[must_use]
    pub fn joint_torques_nm(&self, world: &PhysicsWorld, articulation: &Articulation) -> Vec<f64> {
        let (q, dq) = (articulation.q(world), articulation.dq(world));
        self.joint_idx.iter().enumerate().map(|(nth, idx)| self.drive.servo(nth).effort(q[*idx], dq[*idx])).collect()
    }

    /// `[u1, u2]`, Nm at ratio 1.
    #[must_use]
    pub fn tensions_nm(&self) -> [f64; 2] {
        self.drive.tensions_nm()
    }
}

fn ratio(joint: &HandJoint, k: usize) -> f64 {
    if k == 0 { joint.closing_ratio } else { joint.shifting_ratio }
}

/// The larger of the two motors' tensions.
fn motor_load(u: [f64; 2]) -> f64 {
    u[0].abs() + u[1].abs()
}
