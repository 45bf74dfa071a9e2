//! Building a map: a few cells from random starts, all others from the cells beside them.

use crate::chain::Chain;
use crate::ik::{IkOutcome, IkSettings, IkSolver, random_q};
use crate::reach::map::{Cell, ReachHeader, ReachMap, base_from_shoulder, chain_sha256, shares_of};
use crate::reach::rotations::N_ROTATIONS;
use nalgebra::Vector3;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sfg_types::Pose;

/// How a map is built.
#[derive(Clone, Debug, PartialEq)]
pub struct ReachSettings {
    /// Edge of a voxel, metres. Default 0.05.
    pub resolution_m: f64,
    /// Seed of the random starts. Default 0.
    pub seed: u64,
}

impl Default for ReachSettings {
    fn default() -> Self {
        Self { resolution_m: 0.05, seed: 0 }
    }
}

/// The first pass tries every so many voxels along each axis,
const SOWN_EVERY: usize = 2;
/// with so many random starts a cell.
const SOWN_STARTS: usize = 4;
/// Steps of a descent from a neighbour: those that converge need fewer.
const STEPS: usize = 20;
/// Rotations of the same voxel that a cell is tried from.
const N_NEAR_ROTATIONS: usize = 6;
/// Configurations that measure the box of the palm.
const N_BOX_SAMPLES: usize = 200_000;

/// A map that is being built.
#[derive(Clone, Debug, PartialEq)]
pub struct ReachBuild {
    pub(crate) map: ReachMap,
    /// Cells that the last pass added.
    pub(crate) fresh: Vec<u64>,
}

impl ReachBuild {
    /// An empty map about everything that the palm can reach.
    #[must_use]
    pub fn new(chain: &Chain, robot: &str, arm: &str, settings: &ReachSettings) -> Self {
        let shoulder_from_base = base_from_shoulder(chain).inverse();
        let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for _ in 0..N_BOX_SAMPLES {
            let palm = (shoulder_from_base * chain.fk(&random_q(chain, &mut rng))).translation.vector;
            (low, high) = (low.inf(&palm), high.sup(&palm));
        }
        // Random configurations do not quite meet the farthest: one voxel more on each side.
        let first = low.map(|value| (value / settings.resolution_m).floor() - 1.0);
        let last = high.map(|value| (value / settings.resolution_m).ceil() + 1.0);
        let header = ReachHeader {
            robot: robot.to_owned(),
            arm: arm.to_owned(),
            chain_sha256: chain_sha256(chain),
            resolution_m: settings.resolution_m,
            n_rotations: N_ROTATIONS,
            seed: settings.seed,
            origin_in_shoulder_m: (first * settings.resolution_m).into(),
            size: (last - first).map(|n| n as usize + 1).into(),
            n_joints: chain.n_joints(),
            n_reached: 0,
            n_passes: 0,
            is_complete: false,
        };
        let map = ReachMap::empty(header);
        let fresh = vec![0; map.masks.len()];
        Self { map, fresh }
    }

    /// Whether the map is complete.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.map.header.is_complete
    }

    /// Whether both builds are of the same grid, from the same seed.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        let of = |build: &Self| ReachHeader { n_reached: 0, n_passes: 0, is_complete: false, ..build.map.header.clone() };
        of(self) == of(other)
    }

    /// Voxels that a pass goes through.
    #[must_use]
    pub fn n_voxels(&self) -> usize {
        self.map.masks.len()
    }

    /// The map as far as it is built.
    #[must_use]
    pub fn map(&self) -> &ReachMap {
        &self.map
    }

    /// The map, if it is complete.
    #[must_use]
    pub fn finish(self) -> Option<ReachMap> {
        self.is_done().then_some(self.map)
    }

    /// One pass over all voxels; `on_voxel` hears of each, from any thread.
    ///
    /// A cell sees the state before the pass and draws from a random stream of its own, so the map is the same on any number of
    /// threads.
    pub fn pass(&mut self, chain: &Chain, on_voxel: &(dyn Fn() + Sync)) {
        if self.is_done() {
            return;
        }
        let near = near_rotations(&self.map);
        let found: Vec<(Cell, Vec<u8>)> = (0..self.map.masks.len())
            .into_par_iter()
            .flat_map_iter(|voxel| {
                on_voxel();
                (0..N_ROTATIONS)
                    .filter_map(|rotation| {
                        let cell = (voxel, rotation);
                        let q = if self.map.is_reached(cell) { None } else { self.try_cell(chain, cell, &near) };
                        q.map(|q| (cell, shares_of(chain, &q)))
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        self.map.add(&found);
        self.fresh.fill(0);
        for ((voxel, rotation), _) in &found {
            self.fresh[*voxel] |= 1 << rotation;
        }
        let header = &mut self.map.header;
        header.n_passes += 1;
        header.is_complete = header.n_passes > 1 && found.is_empty();
    }

    fn try_cell(&self, chain: &Chain, cell: Cell, near: &[Vec<usize>]) -> Option<Vec<f64>> {
        let (voxel, rotation) = cell;
        let shoulder_from_palm = Pose::from_parts(self.map.centre_in_shoulder(voxel).into(), self.map.rotation(rotation));
        let target = base_from_shoulder(chain) * shoulder_from_palm;
        let mut rng = ChaCha8Rng::seed_from_u64(self.map.header.seed);
        rng.set_stream((voxel * N_ROTATIONS + rotation) as u64);
        if self.map.header.n_passes > 0 {
            return self.try_neighbours(chain, cell, &target, near, &mut rng);
        }
        if self.map.place(voxel).iter().any(|at| at % SOWN_EVERY != 0) {
            return None;
        }
        let settings = IkSettings { max_starts: SOWN_STARTS, ..IkSettings::default() };
        IkSolver::solve(chain, &target, &random_q(chain, &mut rng), &settings, &mut rng).solution()
    }

    fn try_neighbours(
        &self,
        chain: &Chain,
        cell: Cell,
        target: &Pose,
        near: &[Vec<usize>],
        rng: &mut ChaCha8Rng,
    ) -> Option<Vec<f64>> {
        let settings = IkSettings { max_starts: 1, max_iterations: STEPS, ..IkSettings::default() };
        let mut seed_q = vec![0.0; chain.n_joints()];
        self.neighbours(cell, near).filter(|(voxel, rotation)| self.fresh[*voxel] >> rotation & 1 == 1).find_map(|other| {
            self.map.read_q(chain, other, &mut seed_q);
            match IkSolver::solve(chain, target, &seed_q, &settings, rng) {
                IkOutcome::Solved { q, .. } => Some(q),
                IkOutcome::Failed { .. } => None,
            }
        })
    }

    /// Cells beside a cell: six in space, then the nearest rotations of the same voxel.
    fn neighbours<'a>(&'a self, (voxel, rotation): Cell, near: &'a [Vec<usize>]) -> impl Iterator<Item = Cell> + 'a {
        let at = self.map.place(voxel);
        let in_space = (0..6).filter_map(move |side: usize| {
            let mut beside = at;
            let axis = side % 3;
            beside[axis] = if side < 3 { at[axis].checked_sub(1)? } else { at[axis] + 1 };
            (beside[axis] < self.map.header.size[axis]).then(|| (self.map.voxel(beside), rotation))
        });
        in_space.chain(near[rotation].iter().map(move |other| (voxel, *other)))
    }
}

/// For each rotation the nearest others, nearest first.
fn near_rotations(map: &ReachMap) -> Vec<Vec<usize>> {
    let all = map.rotations();
    (0..all.len())
        .map(|one| {
            let mut others: Vec<usize> = (0..all.len()).filter(|other| *other != one).collect();
            others.sort_by(|a, b| all[one].angle_to(&all[*a]).total_cmp(&all[one].angle_to(&all[*b])).then(a.cmp(b)));
            others.truncate(N_NEAR_ROTATIONS);
            others
        })
        .collect()
}
