//! The map: which palm poses of a grid an arm reaches, and with which joint angles.

use crate::chain::{Chain, JointLimits};
use crate::reach::rotations::{N_ROTATIONS, rotations};
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use sfg_types::Pose;
use sha2::{Digest as _, Sha256};

/// What a map says about itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReachHeader {
    /// Name of the robot, for people.
    pub robot: String,
    /// Which of its arms, for people.
    pub arm: String,
    /// SHA-256 of the chain from its first joint to the palm, as [`chain_sha256`] counts it.
    pub chain_sha256: String,
    /// Edge of a voxel, metres.
    pub resolution_m: f64,
    /// Rotations in each voxel.
    pub n_rotations: usize,
    /// Seed of the random starts.
    pub seed: u64,
    /// Centre of the first voxel in the shoulder frame, metres.
    pub origin_in_shoulder_m: [f64; 3],
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Joints of the arm.
    pub n_joints: usize,
    /// Cells that the arm reaches.
    pub n_reached: usize,
    /// Passes of the build so far.
    pub n_passes: usize,
    /// Whether the last pass added nothing.
    pub is_complete: bool,
}

/// Palm poses on a grid that an arm reaches within its joint limits, each with one configuration that does.
///
/// The grid lies in the **shoulder frame**: that of the arm's first joint, the joint's axis along +Z. So a moved torso needs no new
/// map. Collisions are left out: a pose that is out of reach is so among any obstacles, and in any shape of the hand.
#[derive(Clone, Debug, PartialEq)]
pub struct ReachMap {
    pub(crate) header: ReachHeader,
    /// One bit for each rotation of each voxel, x fastest.
    pub(crate) masks: Vec<u64>,
    /// Reached cells before each voxel.
    n_before: Vec<u32>,
    /// `n_joints` bytes for each reached cell, in the order of cells: shares of the joints' ranges.
    pub(crate) shares: Vec<u8>,
    rotations: Vec<UnitQuaternion<f64>>,
}

/// A cell of the grid: voxel and rotation.
pub(crate) type Cell = (usize, usize);

impl ReachMap {
    /// A map without reached cells.
    pub(crate) fn empty(header: ReachHeader) -> Self {
        let n_voxels = header.size.iter().product();
        Self { header, masks: vec![0; n_voxels], n_before: vec![0; n_voxels], shares: Vec::new(), rotations: rotations() }
    }

    /// Puts masks and joint shares together; `None` when their lengths disagree.
    pub(crate) fn from_parts(header: ReachHeader, masks: Vec<u64>, shares: Vec<u8>) -> Option<Self> {
        let mut map = Self { masks, shares, ..Self::empty(header) };
        map.count();
        (map.shares.len() == map.header.n_reached * map.header.n_joints).then_some(map)
    }

    fn count(&mut self) {
        let mut n = 0;
        for (before, mask) in self.n_before.iter_mut().zip(&self.masks) {
            *before = n;
            n += mask.count_ones();
        }
        self.header.n_reached = n as usize;
    }

    /// Adds cells that are not yet reached; `found` is in the order of cells.
    pub(crate) fn add(&mut self, found: &[(Cell, Vec<u8>)]) {
        let mut shares = Vec::with_capacity(self.shares.len() + found.len() * self.header.n_joints);
        let mut found = found.iter().peekable();
        for (voxel, mask) in self.masks.iter_mut().enumerate() {
            let mut old = self.n_before[voxel] as usize;
            let was = *mask;
            if was == 0 && found.peek().is_none_or(|((v, _), _)| *v != voxel) {
                continue;
            }
            for rotation in 0..N_ROTATIONS {
                if was >> rotation & 1 == 1 {
                    let from = old * self.header.n_joints;
                    shares.extend_from_slice(&self.shares[from..from + self.header.n_joints]);
                    old += 1;
                } else if let Some((_, new)) = found.next_if(|(cell, _)| *cell == (voxel, rotation)) {
                    shares.extend_from_slice(new);
                    *mask |= 1 << rotation;
                }
            }
        }
        self.shares = shares;
        self.count();
    }

    /// What the map says about itself.
    #[must_use]
    pub fn header(&self) -> &ReachHeader {
        &self.header
    }

    /// Voxels times rotations.
    #[must_use]
    pub fn n_cells(&self) -> usize {
        self.masks.len() * N_ROTATIONS
    }

    /// Whether the map was built for this arm: same lengths, axes and limits from the first joint to the palm.
    #[must_use]
    pub fn is_of(&self, chain: &Chain) -> bool {
        self.header.chain_sha256 == chain_sha256(chain)
    }

    pub(crate) fn is_reached(&self, (voxel, rotation): Cell) -> bool {
        self.masks[voxel] >> rotation & 1 == 1
    }

    /// Writes the configuration of a reached cell.
    pub(crate) fn read_q(&self, chain: &Chain, (voxel, rotation): Cell, q: &mut [f64]) {
        let below = self.masks[voxel] & ((1 << rotation) - 1);
        let from = (self.n_before[voxel] + below.count_ones()) as usize * self.header.n_joints;
        for ((value, share), limits) in q.iter_mut().zip(&self.shares[from..]).zip(&chain.limits) {
            let (lower, upper) = range(limits);
            *value = lower + (f64::from(*share) + 0.5) / 256.0 * (upper - lower);
        }
    }

    pub(crate) fn voxel(&self, at: [usize; 3]) -> usize {
        (at[2] * self.header.size[1] + at[1]) * self.header.size[0] + at[0]
    }

    pub(crate) fn place(&self, voxel: usize) -> [usize; 3] {
        let [x, y, _] = self.header.size;
        [voxel % x, voxel / x % y, voxel / (x * y)]
    }

    pub(crate) fn centre_in_shoulder(&self, voxel: usize) -> Vector3<f64> {
        let at = self.place(voxel);
        Vector3::from_fn(|axis, _| self.header.origin_in_shoulder_m[axis] + at[axis] as f64 * self.header.resolution_m)
    }

    pub(crate) fn rotation(&self, rotation: usize) -> UnitQuaternion<f64> {
        self.rotations[rotation]
    }

    pub(crate) fn rotations(&self) -> &[UnitQuaternion<f64>] {
        &self.rotations
    }
}

/// Range that the bytes of a joint divide: its limits, half a turn either way where it has none.
fn range(limits: &JointLimits) -> (f64, f64) {
    let pi = std::f64::consts::PI;
    if limits.lower.is_finite() && limits.upper.is_finite() { (limits.lower, limits.upper) } else { (-pi, pi) }
}

/// Bytes of a configuration.
pub(crate) fn shares_of(chain: &Chain, q: &[f64]) -> Vec<u8> {
    let share = |(value, limits): (&f64, &JointLimits)| {
        let (lower, upper) = range(limits);
        ((value - lower) / (upper - lower) * 256.0).clamp(0.0, 255.0) as u8
    };
    q.iter().zip(&chain.limits).map(share).collect()
}

/// `base_from_shoulder`: the frame of the first joint.
pub(crate) fn base_from_shoulder(chain: &Chain) -> Pose {
    chain.joint(0).before
}

/// SHA-256 of what decides a chain's reach seen from its first joint: kinds, limits and frames of the joints, and the palm.
/// Lengths are rounded to a micrometre, angles to a microradian.
#[must_use]
pub fn chain_sha256(chain: &Chain) -> String {
    let mut hash = Sha256::new();
    let mut add = |value: f64| hash.update(((value * 1e6).round() as i64).to_le_bytes());
    let add_pose = |pose: &Pose, add: &mut dyn FnMut(f64)| {
        pose.translation.vector.iter().for_each(|value| add(*value));
        // The matrix: a quaternion has two signs.
        pose.rotation.to_rotation_matrix().matrix().iter().for_each(|value| add(*value));
    };
    for (idx, limits) in chain.limits.iter().enumerate() {
        let joint = chain.joint(idx);
        add(if joint.is_revolute { 1.0 } else { 0.0 });
        add(limits.lower);
        add(limits.upper);
        if idx > 0 {
            add_pose(&joint.before, &mut add);
        }
    }
    let palm = base_from_shoulder(chain).inverse() * chain.fk(&vec![0.0; chain.n_joints()]);
    add_pose(&palm, &mut add);
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
