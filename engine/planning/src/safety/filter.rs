//! The arm's set points: each passes only if the arm can still come to rest from it.

use super::brake::{Brake, Moving, Window};
use super::limit::{Intervention, Limit};
use super::way::Way;
use crate::collision::CollisionModel;
use crate::qp::{QuadraticProgram, solve_qp};
use nalgebra::{DMatrix, DVector};
use sfg_kinematics::Chain;

/// Where the palm may be, base frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PalmBox {
    /// Smallest x, y, z.
    pub low_m: [f64; 3],
    /// Largest x, y, z.
    pub high_m: [f64; 3],
}

/// What the filter lets pass, beyond the joints' own limits.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterSettings {
    /// Where the palm may be.
    pub palm_box: PalmBox,
    /// A set point that was moved by less than this passed unchanged, radians. Default 1e-9.
    pub tolerance_rad: f64,
    /// The way to rest is looked at in steps in which nothing moves farther than this, metres. Default 0.005 m. Things must be half of it
    /// apart, so that nothing is met between two looks.
    pub look_step_m: f64,
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self {
            // In front of and beside the robot, above the floor.
            palm_box: PalmBox { low_m: [-0.3, -1.2, 0.3], high_m: [1.4, 1.2, 2.1] },
            tolerance_rad: 1e-9,
            look_step_m: 0.005,
        }
    }
}

/// What goes to the driver.
#[derive(Clone, Debug, PartialEq)]
pub struct Sent {
    /// Joint positions at the end of the period.
    pub q: Vec<f64>,
    /// Joint velocities at that moment.
    pub dq: Vec<f64>,
    /// What was changed, if anything was.
    pub intervention: Option<Intervention>,
}

/// Stands between every source of commands and the arm, once a control period.
///
/// Held always: from the last set point sent there is a way to rest on which every joint keeps position, velocity, acceleration and
/// jerk (as finite differences of the positions sent), the palm its box, and everything its distance. A command passes unchanged if
/// that also holds after it. Else the nearest one is looked for: joint by joint for the joints' limits, then by a quadratic program
/// over the places of rest for box and distances. If there is none, the arm follows the way to rest that it has.
///
/// What is broken already, as after a change of the world, may not become worse.
#[derive(Clone, Debug)]
pub struct SafetyFilter {
    chain: Chain,
    settings: FilterSettings,
    brakes: Vec<Brake>,
    period_secs: f64,
    world: Option<CollisionModel>,
    reaches_m: Vec<f64>,
    /// Joint by joint: which tips it moves.
    moves_tip: Vec<Vec<bool>>,
    at: Vec<Moving>,
    wanted_before: Option<Vec<f64>>,
    /// What the arm is kept from touching now.
    touching: Option<Intervention>,
    /// Distance that is kept from things, metres.
    kept_m: f64,
    is_new_world: bool,
    /// Joints that were where their source wanted them in the last period.
    follows: Vec<bool>,
    is_stopped: bool,
}

/// Speeds below this are rounding, rad/s.
const REST_SPEED: f64 = 1e-9;
/// Positions beyond a limit by less than this are rounding.
const ROUNDING_RAD: f64 = 1e-12;
/// The palm keeps this from the walls of its box, as its way is looked at in steps.
const BOX_MARGIN_M: f64 = 1e-4;
/// The quadratic program keeps this much more than the check asks for.
const SHAPE_MARGIN_M: f64 = 3e-4;
/// Things farther than this from the place of rest do not matter for the next period.
const NEAR_M: f64 = 0.03;
/// Gaps that are rows of the quadratic program.
const N_GAPS: usize = 10;
/// Distances of single precision are right to this.
const ROUNDING_M: f64 = 1e-6;
/// Things that are nearer than this are looked at one by one, so many times on the way to rest at most.
const LEAST_KEPT_M: f64 = 2e-4;
const MOST_LOOKS: usize = 24;
/// Longest way to rest, periods.
const MOST_PERIODS: usize = 100_000;

impl SafetyFilter {
    /// For an arm at rest at `q`, commanded every `period_secs`.
    ///
    /// # Panics
    /// If `q` does not fit the chain, a joint lacks a limit of velocity, acceleration or jerk, or the period is not positive.
    #[must_use]
    pub fn new(chain: Chain, q: &[f64], period_secs: f64, settings: FilterSettings) -> Self {
        assert_eq!(q.len(), chain.n_joints(), "one value for each joint");
        assert!(period_secs > 0.0 && settings.look_step_m > 0.0, "period and step are positive");
        let is_limit = |value: f64| value > 0.0 && value.is_finite();
        for (name, l) in chain.joint_names.iter().zip(&chain.limits) {
            assert!(is_limit(l.velocity) && is_limit(l.acceleration) && is_limit(l.jerk), "joint {name:?} lacks a limit: {l:?}");
        }
        let brakes = chain.limits.iter().map(|limits| Brake::new(limits, period_secs)).collect();
        let reaches_m = reaches_m(&chain);
        let settings_step_m = settings.look_step_m;
        let moves_tip = (0..q.len()).map(|idx| (0..chain.n_tips()).map(|tip| chain.moves_tip(idx, tip)).collect()).collect();
        let mut filter = Self {
            chain,
            settings,
            brakes,
            period_secs,
            world: None,
            reaches_m,
            moves_tip,
            at: Vec::new(),
            wanted_before: None,
            touching: None,
            kept_m: 0.5 * settings_step_m,
            is_new_world: true,
            follows: Vec::new(),
            is_stopped: false,
        };
        filter.reset(q);
        filter
    }

    /// Takes over an arm that rests at `q`, and lets it move again after a stop.
    pub fn reset(&mut self, q: &[f64]) {
        self.at = q.iter().map(|q| Moving { q: *q, v: 0.0, a: 0.0 }).collect();
        self.wanted_before = None;
        self.follows = vec![true; q.len()];
        self.is_new_world = true;
        self.is_stopped = false;
    }

    /// Replaces what must not be touched: obstacles with keep-out boxes among them, the robot itself, what the hand holds.
    ///
    /// # Panics
    /// If the model is that of another arm.
    pub fn set_world(&mut self, world: Option<CollisionModel>) {
        if let Some(world) = &world {
            assert_eq!(world.chain().n_joints(), self.at.len(), "a model of the same arm");
            self.reaches_m = world.reaches_m().iter().zip(reaches_m(&self.chain)).map(|(a, b)| a.max(b)).collect();
        }
        self.world = world;
        self.is_new_world = true;
    }

    /// The arm, with the limits that are kept.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Brings the arm to rest from any state; no command passes until [`Self::reset`].
    pub fn stop(&mut self) {
        self.is_stopped = true;
    }

    /// Whether the arm was stopped.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.is_stopped
    }

    /// Whether the last set point stands.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.at.iter().all(Moving::is_at_rest)
    }

    /// The set point of the coming period: `wanted` (positions and velocities at its end), or what the limits leave of it. Without one
    /// the arm comes to rest.
    pub fn step(&mut self, wanted: Option<(&[f64], &[f64])>) -> Sent {
        if self.is_stopped {
            let moves = !self.is_at_rest();
            return self.brake(moves.then(|| reason("arm", Limit::Stopped, 0.0, 0.0, "")));
        }
        let Some((q, dq)) = wanted else {
            self.wanted_before = None;
            let moves = !self.is_at_rest();
            return self.brake(moves.then(|| reason("arm", Limit::Silence, 0.0, 0.0, "")));
        };
        let n = self.at.len();
        for given in [q, dq] {
            if given.len() != n {
                return self.refuse(reason("arm", Limit::Length, given.len() as f64, n as f64, "joints"));
            }
            if let Some(idx) = given.iter().position(|value| !value.is_finite()) {
                let name = self.chain.joint_names[idx].clone();
                return self.refuse(reason(&name, Limit::NotANumber, given[idx], 0.0, "rad"));
            }
        }
        self.keep_distance();
        let before = self.wanted_before.replace(q.to_vec()).unwrap_or_else(|| q.to_vec());
        let windows: Vec<Window> = self.windows();
        let (mut broken, mut passes) = (None, true);
        let mut follows = vec![false; n];
        let accelerations: Vec<f64> = (0..n)
            .map(|idx| {
                let exact = self.at[idx].acceleration_to(q[idx], self.period_secs);
                let window = &windows[idx];
                let beyond = (window.low - exact).max(exact - window.high) * self.period_secs * self.period_secs;
                if beyond <= ROUNDING_RAD && (self.follows[idx] || self.would_follow(idx, exact, q[idx] - before[idx])) {
                    follows[idx] = true;
                    return exact;
                }
                passes = false;
                if self.follows[idx] && beyond <= self.settings.tolerance_rad {
                    follows[idx] = true;
                    return exact.clamp(window.low, window.high);
                }
                broken.get_or_insert_with(|| self.limit_of(idx, q[idx], exact));
                self.tracking(idx, q[idx], before[idx], window)
            })
            .collect();
        self.follows = follows;
        let Some(touched) = self.touched_on_the_way(&accelerations) else {
            self.touching = None;
            let next = if passes { q.to_vec() } else { self.reached(&accelerations) };
            return self.go(next, Some(dq), broken).changed_from(q);
        };
        self.follows.fill(false);
        // Named once, as long as it lasts.
        let why = self.touching.take().unwrap_or_else(|| self.name_touch(touched));
        self.touching = Some(why.clone());
        match self.shaped(&accelerations, &windows).filter(|shaped| self.touched_on_the_way(shaped).is_none()) {
            Some(shaped) => self.go(self.reached(&shaped), Some(dq), Some(why)).changed_from(q),
            None => self.brake(Some(why)).changed_from(q),
        }
    }

    /// Whether a joint that meets its source in this period can stay with it: one that only runs across it would swing about it.
    fn would_follow(&self, idx: usize, exact: f64, source_step: f64) -> bool {
        let next = self.at[idx].next(exact, self.period_secs);
        let after = (source_step / self.period_secs - next.v) / self.period_secs;
        (after - exact).abs() <= self.chain.limits[idx].jerk * self.period_secs
    }

    /// Positions after one period with these accelerations.
    fn reached(&self, accelerations: &[f64]) -> Vec<f64> {
        self.at.iter().zip(accelerations).map(|(at, a)| at.next(*a, self.period_secs).q).collect()
    }

    fn windows(&self) -> Vec<Window> {
        (self.at.iter().zip(&self.brakes).zip(&self.chain.limits))
            // Outside its range a joint may come back but not go on.
            .map(|((at, brake), limits)| brake.window(at, limits.lower.min(at.q), limits.upper.max(at.q)))
            .collect()
    }

    /// The acceleration of a joint whose source is out of reach for now: towards where the source itself could come to rest, so that
    /// the joint meets it without running past.
    fn tracking(&self, idx: usize, wanted: f64, before: f64, window: &Window) -> f64 {
        let limits = &self.chain.limits[idx];
        let v = ((wanted - before) / self.period_secs).clamp(-limits.velocity, limits.velocity);
        let source = Moving { q: wanted.clamp(limits.lower, limits.upper), v, a: 0.0 };
        let rest = source.q + self.brakes[idx].way_to_rest(&source);
        self.brakes[idx].towards(&self.at[idx], rest, window)
    }

    /// The limit that the acceleration `exact` breaks.
    fn limit_of(&self, idx: usize, wanted: f64, exact: f64) -> Intervention {
        let (name, limits, at) = (&self.chain.joint_names[idx], &self.chain.limits[idx], &self.at[idx]);
        let v = (wanted - at.q) / self.period_secs;
        let jerk = (exact - at.a) / self.period_secs;
        if wanted < limits.lower || wanted > limits.upper {
            let bound = if wanted < limits.lower { limits.lower } else { limits.upper };
            reason(name, Limit::Position, wanted, bound, "rad")
        } else if v.abs() > limits.velocity * (1.0 + 1e-9) {
            reason(name, Limit::Velocity, v, limits.velocity.copysign(v), "rad/s")
        } else if exact.abs() > limits.acceleration * (1.0 + 1e-9) {
            reason(name, Limit::Acceleration, exact, limits.acceleration.copysign(exact), "rad/s^2")
        } else if jerk.abs() > limits.jerk * (1.0 + 1e-9) {
            reason(name, Limit::Jerk, jerk, limits.jerk.copysign(jerk), "rad/s^3")
        } else {
            // Within all limits now, but too fast to stop before the end of its range, or still on the way to its source.
            let rest = self.brakes[idx].rest_after(at, exact);
            if rest < limits.lower || rest > limits.upper {
                let bound = if rest < limits.lower { limits.lower } else { limits.upper };
                return reason(name, Limit::Position, rest, bound, "rad");
            }
            reason(name, Limit::Jerk, jerk, limits.jerk.copysign(jerk), "rad/s^3")
        }
    }

    /// The way to rest after one period with these accelerations.
    fn way_to_rest(&self, accelerations: &[f64]) -> Way {
        let mut at: Vec<Moving> = self.at.iter().zip(accelerations).map(|(at, a)| at.next(*a, self.period_secs)).collect();
        let mut way = Way::from(at.iter().map(|at| at.q).collect());
        let mut by_tip = vec![0.0; self.chain.n_tips()];
        // Braking ends by itself; a filter must end whatever happens.
        while !at.iter().all(Moving::is_at_rest) && way.len() < MOST_PERIODS {
            by_tip.fill(0.0);
            let mut all_m = 0.0;
            for (idx, at) in at.iter_mut().enumerate() {
                if at.is_at_rest() {
                    continue;
                }
                let next = braked(&self.brakes[idx], at);
                let moved_m = (next.q - at.q).abs() * self.reaches_m[idx];
                all_m += moved_m;
                by_tip.iter_mut().zip(&self.moves_tip[idx]).for_each(|(sum, moves)| *sum += if *moves { moved_m } else { 0.0 });
                *at = next;
            }
            way.push(at.iter().map(|at| at.q), by_tip.iter().copied().fold(0.0, f64::max), all_m);
        }
        way
    }

    /// What the palm or the arm would run into on the way to rest after these accelerations.
    fn touched_on_the_way(&self, accelerations: &[f64]) -> Option<Touched> {
        let way = self.way_to_rest(accelerations);
        if let Some(found) = self.leaves_box(&way) {
            return Some(Touched::Wall(found));
        }
        let world = self.world.as_ref()?;
        if self.kept_m > LEAST_KEPT_M {
            return way.first_met(world, 2.0 * self.kept_m).map(|met| Touched::Thing(way.at(met).to_vec()));
        }
        // Things touch, or nearly so: eight at once cannot tell by how much.
        let looks = way.spread(MOST_LOOKS);
        let gap_m = |idx: usize| world.least_gap_m(way.at(idx), self.needed_m()).unwrap_or(f64::INFINITY);
        looks.into_iter().find(|idx| gap_m(*idx) < self.kept_m).map(|idx| Touched::Thing(way.at(idx).to_vec()))
    }

    /// Sets the distance that is kept: what is needed, or what there is where things are nearer already. It never shrinks but by a
    /// change of the world.
    fn keep_distance(&mut self) {
        let Some(world) = &self.world else { return };
        let needed_m = self.needed_m();
        if self.kept_m >= needed_m && !self.is_new_world {
            return;
        }
        let now: Vec<f64> = self.at.iter().map(|at| at.q).collect();
        let there_m = world.least_gap_m(&now, needed_m + ROUNDING_M).map_or(needed_m, |gap_m| gap_m - ROUNDING_M);
        self.kept_m = if self.is_new_world { there_m } else { self.kept_m.max(there_m) };
        self.is_new_world = false;
    }

    /// Walls of each palm's box, moved out to the palm where it is outside already.
    fn walls(&self) -> Vec<PalmBox> {
        let now: Vec<f64> = self.at.iter().map(|at| at.q).collect();
        let walls = |tip: usize| {
            let palm = self.chain.fk_of(tip, &now).translation.vector;
            let PalmBox { mut low_m, mut high_m } = self.settings.palm_box;
            for axis in 0..3 {
                low_m[axis] = (low_m[axis] + BOX_MARGIN_M).min(palm[axis]);
                high_m[axis] = (high_m[axis] - BOX_MARGIN_M).max(palm[axis]);
            }
            PalmBox { low_m, high_m }
        };
        (0..self.chain.n_tips()).map(walls).collect()
    }

    fn leaves_box(&self, way: &Way) -> Option<Intervention> {
        self.walls().iter().enumerate().find_map(|(tip, walls)| self.palm_leaves(tip, walls, way))
    }

    fn palm_leaves(&self, tip: usize, walls: &PalmBox, way: &Way) -> Option<Intervention> {
        let mut idx = 0;
        loop {
            let palm = self.chain.fk_of(tip, way.at(idx)).translation.vector;
            let mut room_m = f64::INFINITY;
            for axis in 0..3 {
                let inside_m = (palm[axis] - walls.low_m[axis]).min(walls.high_m[axis] - palm[axis]);
                if inside_m < -1e-9 {
                    let PalmBox { low_m, high_m } = self.settings.palm_box;
                    let bound = if palm[axis] < walls.low_m[axis] { low_m[axis] } else { high_m[axis] };
                    return Some(reason(["palm x", "palm y", "palm z"][axis], Limit::Workspace, palm[axis], bound, "m"));
                }
                room_m = room_m.min(inside_m);
            }
            if idx + 1 == way.len() {
                return None;
            }
            // No wall is met before the palm has moved as far as it is away.
            let reached_m = way.ball_moved_m[idx] + room_m.max(0.0);
            idx = way.ball_moved_m.partition_point(|moved_m| *moved_m < reached_m).clamp(idx + 1, way.len() - 1);
        }
    }

    /// Distance that things keep at each look.
    fn needed_m(&self) -> f64 {
        0.5 * self.settings.look_step_m
    }

    /// Says what would touch what in a configuration.
    fn name_touch(&self, touched: Touched) -> Intervention {
        let q = match touched {
            Touched::Wall(found) => return found,
            Touched::Thing(q) => q,
        };
        let contact = self.world.as_ref().and_then(|world| world.contact_within(&q, NEAR_M));
        let Some(contact) = contact else { return reason("arm", Limit::Distance, 0.0, self.needed_m(), "m") };
        let gap_m = NEAR_M - contact.depth_m;
        let subject = format!("{} would come within {:.1} mm of {}", contact.link, gap_m.max(0.0) * 1e3, contact.with);
        reason(&subject, Limit::Distance, gap_m, self.needed_m(), "m")
    }

    /// Accelerations whose place of rest is nearest to that of `accelerations` among those that keep box and distances, by their
    /// linear model there.
    fn shaped(&self, accelerations: &[f64], windows: &[Window]) -> Option<Vec<f64>> {
        let n = accelerations.len();
        let rest = |idx: usize, a: f64| self.brakes[idx].rest_after(&self.at[idx], a);
        let wanted: Vec<f64> = (0..n).map(|idx| rest(idx, accelerations[idx])).collect();
        let reach: Vec<(f64, f64)> = (windows.iter().enumerate())
            .map(|(idx, window)| (rest(idx, window.low) - wanted[idx], rest(idx, window.high) - wanted[idx]))
            .collect();
        let mut rows: Vec<(Vec<f64>, f64)> = Vec::with_capacity(2 * n + 6 * self.chain.n_tips() + N_GAPS);
        for (idx, (low, high)) in reach.iter().enumerate() {
            let unit = |sign: f64| (0..n).map(|column| if column == idx { sign } else { 0.0 }).collect::<Vec<f64>>();
            rows.push((unit(1.0), *high));
            rows.push((unit(-1.0), -low));
        }
        // How far the joints can lower `along x` in this period: no row asks for more than half of it, so that each can be met.
        let room = |along: &[f64]| -> f64 { along.iter().zip(&reach).map(|(v, (low, high))| (v * low).min(v * high)).sum() };
        let mut keep = |along: Vec<f64>, bound: f64| {
            let bound = bound.max(0.5 * room(&along));
            rows.push((along, bound));
        };
        for (tip, walls) in self.walls().iter().enumerate() {
            let palm = self.chain.fk_of(tip, &wanted).translation.vector;
            let jacobian = self.chain.jacobian_of(tip, &wanted);
            for axis in 0..3 {
                let along: Vec<f64> = jacobian.row(axis).iter().copied().collect();
                let against = along.iter().map(|v| -v).collect();
                keep(along, walls.high_m[axis] - palm[axis] - BOX_MARGIN_M);
                keep(against, palm[axis] - walls.low_m[axis] - BOX_MARGIN_M);
            }
        }
        if let Some(world) = &self.world {
            let needed_m = self.needed_m() + SHAPE_MARGIN_M;
            for gap in world.gaps(&wanted, NEAR_M, N_GAPS) {
                keep(gap.gradient.iter().map(|v| -v).collect(), gap.gap_m - needed_m);
            }
        }
        let program = QuadraticProgram {
            hessian: DMatrix::identity(n, n),
            gradient: DVector::zeros(n),
            rows: DMatrix::from_fn(rows.len(), n, |row, column| rows[row].0[column]),
            bounds: DVector::from_fn(rows.len(), |row, _| rows[row].1),
        };
        let solution = solve_qp(&program).ok()?;
        let towards = |idx: usize| self.brakes[idx].towards(&self.at[idx], wanted[idx] + solution.x[idx], &windows[idx]);
        Some((0..n).map(towards).collect())
    }

    /// Sends no part of a command that cannot be read.
    fn refuse(&mut self, why: Intervention) -> Sent {
        self.wanted_before = None;
        self.brake(Some(why))
    }

    /// One period further on the way to rest.
    fn brake(&mut self, why: Option<Intervention>) -> Sent {
        self.follows.fill(false);
        let next = self.at.iter().zip(&self.brakes).map(|(at, brake)| braked(brake, at).q).collect();
        self.go(next, None, why)
    }

    /// Moves on to `q`; velocities as the source has them if they agree with the positions.
    ///
    /// All is taken from the positions alone, so that a log that is sent again meets the same filter.
    fn go(&mut self, q: Vec<f64>, dq: Option<&[f64]>, intervention: Option<Intervention>) -> Sent {
        for (at, q) in self.at.iter_mut().zip(&q) {
            let v = (q - at.q) / self.period_secs;
            *at = resting(Moving { q: *q, v, a: (v - at.v) / self.period_secs }, self.period_secs);
        }
        let dq = (self.at.iter().zip(&self.chain.limits).enumerate())
            .map(|(idx, (at, limits))| {
                let wanted = dq.map_or(at.v, |dq| dq[idx]);
                let agrees = (wanted - at.v).abs() <= limits.acceleration * self.period_secs && wanted.abs() <= limits.velocity;
                if agrees { wanted } else { at.v }
            })
            .collect();
        Sent { q, dq, intervention }
    }
}

/// What is met on the way to rest.
enum Touched {
    Wall(Intervention),
    /// Something, in this configuration.
    Thing(Vec<f64>),
}

impl Sent {
    /// Notes by how much the set point differs from the one asked for.
    fn changed_from(mut self, wanted: &[f64]) -> Self {
        let by = self.q.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if let Some(intervention) = &mut self.intervention {
            intervention.by = by;
        }
        self
    }
}

/// A joint one period further on its way to rest.
fn braked(brake: &Brake, at: &Moving) -> Moving {
    resting(at.next(brake.braking(at), brake.period_secs()), brake.period_secs())
}

/// What is left of a motion but for rounding.
fn resting(at: Moving, period_secs: f64) -> Moving {
    if at.v.abs() < REST_SPEED && at.a.abs() * period_secs < REST_SPEED { Moving { v: 0.0, a: 0.0, ..at } } else { at }
}

/// How far a radian (or metre) of each joint can move a tip, at most.
fn reaches_m(chain: &Chain) -> Vec<f64> {
    let mut reaches = vec![0.0; chain.n_joints()];
    let n_compiled = chain.link_names.len();
    let at_zero = chain.fk_all(&vec![0.0; chain.n_joints()]);
    for tip in 0..chain.n_tips() {
        let mut at = chain.tip_joint(tip);
        let mut reach =
            at.map_or(0.0, |idx| (at_zero[n_compiled + tip].translation.vector - at_zero[idx].translation.vector).norm());
        while let Some(idx) = at {
            let joint = chain.joint(idx);
            let own = joint.multiplier.abs() * if joint.is_revolute { reach } else { 1.0 };
            reaches[joint.q_idx] = f64::max(reaches[joint.q_idx], own);
            reach += joint.before.translation.vector.norm();
            at = joint.parent;
        }
    }
    reaches
}

fn reason(subject: &str, limit: Limit, value: f64, bound: f64, unit: &'static str) -> Intervention {
    Intervention { subject: subject.to_owned(), limit, value, bound, unit, by: 0.0 }
}
