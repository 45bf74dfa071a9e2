//! `sfg safety bench`: commands of all kinds through the safety filter, and an independent look at everything that was sent.

use crate::assets::Assets;
use crate::check::BadInput;
use crate::say::say;
use crate::statistics::wilson_interval;
use anyhow::{Context as _, Result};
use indicatif::{ProgressBar, ProgressStyle};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{RobotModel, Shape};
use sfg_planning::safety::{Breach, audit};
use sfg_planning::{
    CollisionModel, CollisionSettings, FilterSettings, Limit, Obstacle, PlanOutcome, Planner as _, RrtConnect, SafetyFilter,
    TimingSettings, retime, verify_exact,
};
use sfg_types::{HandSide, JointTrajectory, Pose, Vector};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// The safety filter.
#[derive(clap::Subcommand)]
pub(crate) enum SafetyCommand {
    /// Sends hostile and well-behaved commands through the filter at 1 kHz and checks the positions sent, by themselves.
    Bench(BenchOptions),
}

#[derive(clap::Args)]
pub(crate) struct BenchOptions {
    /// Name of a robot in the assets; its left arm moves.
    #[arg(long, default_value = "curi")]
    robot: String,
    /// Hostile trajectories.
    #[arg(long, default_value_t = 10_000)]
    n: usize,
    /// Planned trajectories.
    #[arg(long, default_value_t = 1000)]
    plans: usize,
    /// Length of a hostile trajectory, seconds.
    #[arg(long, default_value_t = 1.0)]
    secs: f64,
    /// Seed of scenes, starts and commands.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Writes every trajectory's figures to this file.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

const PERIOD_SECS: f64 = 0.001;
/// Samples between two looks by exact shapes.
const EXACT_EVERY: usize = 20;
/// A planned motion that could not be stopped in time is timed again at this share of its speed, as the engine does.
const SLOWER: f64 = 0.6;
const SPEEDS_TRIED: usize = 4;

/// What a source does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    /// Every position is somewhere else.
    Noise,
    /// Jumps to another configuration now and then.
    Jumps,
    /// Sines faster and wider than the joints.
    Sines,
    /// Numbers that are none among a slow motion.
    NotNumbers,
    /// A motion that freezes and goes on elsewhere.
    Frozen,
    /// Slowly on and on, into limits and things.
    Drift,
    /// A source that falls silent in the middle of a motion.
    Silent,
    /// One joint, faster than it can, there and back over its range.
    Racing,
}

const KINDS: [Kind; 8] =
    [Kind::Noise, Kind::Jumps, Kind::Sines, Kind::NotNumbers, Kind::Frozen, Kind::Drift, Kind::Silent, Kind::Racing];

/// Figures of one hostile trajectory.
#[derive(Serialize)]
struct Tried {
    trial: usize,
    kind: Kind,
    n_interventions: usize,
    breaches: Vec<Breach>,
    /// By exact shapes: what touched.
    exact_contact: Option<String>,
    /// Speed of the racing joint while it was asked to go faster than it may and had room, share of its limit.
    speed_share: Option<f64>,
    median_micros: f64,
    p99_micros: f64,
}

/// Figures of one planned trajectory.
#[derive(Serialize)]
struct Planned {
    trial: usize,
    /// Share of the speed limits at which it passed; none when it never did.
    speed: Option<f64>,
    largest_change_rad: f64,
    why: Option<String>,
}

struct Bench<'a> {
    options: &'a BenchOptions,
    model: RobotModel,
    empty: CollisionModel,
}

/// A scene of its own and a free start in it.
struct Scene {
    world: CollisionModel,
    start: Vec<f64>,
    rng: ChaCha8Rng,
}

pub(crate) fn run(assets: &Assets, SafetyCommand::Bench(options): &SafetyCommand) -> Result<ExitCode> {
    if !(options.secs > 0.0 && options.secs <= 3600.0) {
        return Err(BadInput(format!("--secs {}: expected more than 0 and at most 3600", options.secs)).into());
    }
    let path = assets.robots.get(&options.robot).ok_or_else(|| {
        let known = assets.robots.keys().cloned().collect::<Vec<_>>().join(", ");
        BadInput(format!("no robot is called {:?}; the assets have {known}", options.robot))
    })?;
    let model = RobotModel::load(path).map_err(|error| BadInput(error.to_string()))?;
    let settings = CollisionSettings { clearance_m: 0.0, self_clearance_m: 0.0, ..CollisionSettings::default() };
    let empty =
        CollisionModel::new(&model, HandSide::Left, &model.home_q, settings).map_err(|error| BadInput(error.to_string()))?;
    let bench = Bench { options, model, empty };
    let hostile = on_all_cores("hostile", options.n, |trial| bench.hostile(trial))?;
    print_hostile(&hostile, options);
    let planned = on_all_cores("planned", options.plans, |trial| bench.planned(trial))?;
    print_planned(&planned);
    if let Some(path) = &options.json {
        let text = serde_json::to_string(&serde_json::json!({"hostile": hostile, "planned": planned}))?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let is_clean = hostile.iter().all(|one| one.breaches.is_empty() && one.exact_contact.is_none());
    Ok(if is_clean { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Runs trials on all cores, in order.
fn on_all_cores<T: Send>(what: &'static str, n: usize, work: impl Fn(usize) -> T + Sync) -> Result<Vec<T>> {
    let bar = ProgressBar::new(n as u64)
        .with_style(ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} {eta}")?)
        .with_prefix(what);
    let done = (0..n).into_par_iter().map(|trial| (work(trial), bar.inc(1)).0).collect();
    bar.finish_and_clear();
    Ok(done)
}

impl Bench<'_> {
    /// A table with up to five things on it, and a random free configuration.
    fn scene(&self, trial: usize, stream: u64) -> Scene {
        let mut rng = ChaCha8Rng::seed_from_u64(self.options.seed);
        rng.set_stream(stream << 32 | trial as u64);
        let table = Shape::Cuboid { half_extents_m: Vector::new(0.575, 1.2, 0.03) };
        let mut obstacles =
            vec![Obstacle { name: "table".to_owned(), shape: table, pose_in_base: Pose::translation(1.025, 0.0, 0.72) }];
        for nth in 0..rng.random_range(0..=5) {
            let (radius_m, half_length_m) = (rng.random_range(0.02..0.08), rng.random_range(0.03..0.2));
            let shape = match rng.random_range(0..3) {
                0 => Shape::Cylinder { radius_m, half_length_m },
                1 => Shape::Cuboid { half_extents_m: Vector::new(radius_m, radius_m, half_length_m) },
                _ => Shape::Sphere { radius_m },
            };
            let (x, y) = (rng.random_range(0.5..0.9), rng.random_range(-0.2..0.8));
            let pose_in_base = Pose::translation(x, y, 0.75 + half_length_m);
            obstacles.push(Obstacle { name: format!("thing {nth}"), shape, pose_in_base });
        }
        let mut world = self.empty.clone();
        world.set_world(&obstacles, None);
        let mut start = self.model.left.home_q.clone();
        for _ in 0..1000 {
            let q = random_q(world.chain(), &mut rng);
            let palm = world.chain().fk(&q).translation.vector;
            let palm_box = FilterSettings::default().palm_box;
            let is_inside = (0..3).all(|axis| (palm_box.low_m[axis]..palm_box.high_m[axis]).contains(&palm[axis]));
            if is_inside && world.is_free(&q) {
                start = q;
                break;
            }
        }
        Scene { world, start, rng }
    }

    fn filter(&self, scene: &Scene, start: &[f64]) -> SafetyFilter {
        let mut filter = SafetyFilter::new(scene.world.chain().clone(), start, PERIOD_SECS, FilterSettings::default());
        filter.set_world(Some(scene.world.clone()));
        filter
    }

    fn hostile(&self, trial: usize) -> Tried {
        let kind = KINDS[trial % KINDS.len()];
        let mut scene = self.scene(trial, 1);
        if kind == Kind::Racing {
            // Its speed is measured: nothing but the robot itself is in the way.
            scene.world.set_world(&[], None);
        }
        let mut filter = self.filter(&scene, &scene.start);
        let n = (self.options.secs / PERIOD_SECS).ceil() as usize;
        let commands = commands(kind, &scene.start.clone(), &self.model, n, &mut scene);
        let mut log = vec![scene.start.clone(); 3];
        let mut micros = Vec::with_capacity(n);
        let (mut n_interventions, mut is_near) = (0, Vec::with_capacity(n));
        for wanted in &commands {
            let begun = Instant::now();
            let sent = filter.step(wanted.as_ref().map(|(q, dq)| (q.as_slice(), dq.as_slice())));
            micros.push(1e6 * begun.elapsed().as_secs_f64());
            let found = sent.intervention.map(|found| found.limit);
            n_interventions += usize::from(found.is_some_and(|limit| limit != Limit::Silence));
            is_near.push(matches!(found, Some(Limit::Distance | Limit::Workspace)));
            log.push(sent.q);
        }
        let chain = scene.world.chain();
        let breaches = audit(&log, chain, PERIOD_SECS, &FilterSettings::default().palm_box, Some(&scene.world));
        let looks: Vec<Vec<f64>> = log.iter().step_by(EXACT_EVERY).cloned().collect();
        let exact = verify_exact(&self.model, HandSide::Left, &self.model.home_q, &scene.world, &looks, f64::INFINITY);
        micros.sort_by(f64::total_cmp);
        Tried {
            trial,
            kind,
            n_interventions,
            breaches,
            exact_contact: exact.map(|contact| contact.to_string()),
            speed_share: (kind == Kind::Racing).then(|| racing_share(&log, &commands, &is_near, chain)).flatten(),
            median_micros: micros[n / 2],
            p99_micros: micros[(n * 99 / 100).min(n - 1)],
        }
    }

    fn planned(&self, trial: usize) -> Planned {
        let mut scene = self.scene(trial, 2);
        let none = |why: &str| Planned { trial, speed: None, largest_change_rad: 0.0, why: Some(why.to_owned()) };
        // The planner keeps its usual clearance.
        let mut careful = scene.world.clone();
        let usual = CollisionSettings::default();
        careful.set_clearance(usual.clearance_m, usual.self_clearance_m);
        let mut path = None;
        for seed in 0..50 {
            let (from, to) = (random_q(careful.chain(), &mut scene.rng), random_q(careful.chain(), &mut scene.rng));
            if let PlanOutcome::Found(found) = RrtConnect::default().plan(&careful, &from, &[to], seed)
                && stays_inside(careful.chain(), &found)
            {
                path = Some(found);
                break;
            }
        }
        let Some(path) = path else { return none("no plan") };
        let mut why = None;
        for tried in 0..SPEEDS_TRIED {
            let speed = SLOWER.powi(tried as i32);
            let settings = TimingSettings { speed_fraction: speed, sample_period_secs: PERIOD_SECS, ..TimingSettings::default() };
            let motion = match retime(&path, careful.chain(), &settings, Some(&careful)) {
                Ok(motion) => motion,
                Err(error) => return none(&error.to_string()),
            };
            match self.passes(&scene, &motion) {
                Ok(largest_change_rad) => return Planned { trial, speed: Some(speed), largest_change_rad, why },
                Err(found) => why = Some(found),
            }
        }
        Planned { trial, speed: None, largest_change_rad: 0.0, why }
    }

    /// The largest change of a position when the motion passes unchanged; else what the filter would have changed.
    fn passes(&self, scene: &Scene, motion: &JointTrajectory) -> Result<f64, String> {
        let mut filter = self.filter(scene, &motion.q[0]);
        let mut largest: f64 = 0.0;
        for (q, dq) in motion.q.iter().zip(&motion.dq).skip(1) {
            let sent = filter.step(Some((q, dq)));
            if let Some(found) = sent.intervention {
                return Err(found.to_string());
            }
            largest = sent.q.iter().zip(q).map(|(a, b)| (a - b).abs()).fold(largest, f64::max);
        }
        Ok(largest)
    }
}

/// Whether the palm keeps well within its box, of which the planner does not know.
fn stays_inside(chain: &sfg_kinematics::Chain, path: &[Vec<f64>]) -> bool {
    let palm_box = FilterSettings::default().palm_box;
    path.windows(2).all(|pair| {
        (0..=20).all(|nth| {
            let q: Vec<f64> = pair[0].iter().zip(&pair[1]).map(|(a, b)| a + (b - a) * f64::from(nth) / 20.0).collect();
            let palm = chain.fk(&q).translation.vector;
            (0..3).all(|axis| (palm_box.low_m[axis] + 0.1..palm_box.high_m[axis] - 0.1).contains(&palm[axis]))
        })
    })
}

type Command = Option<(Vec<f64>, Vec<f64>)>;

/// What a source says in each period.
fn commands(kind: Kind, start: &[f64], model: &RobotModel, n: usize, scene: &mut Scene) -> Vec<Command> {
    let Scene { world, rng, .. } = scene;
    let limits = &model.left.chain.limits;
    let joints = start.len();
    let mut each = |low: f64, high: f64| (0..joints).map(|_| rng.random_range(low..high)).collect::<Vec<f64>>();
    let (amplitude, frequency, drift) = (each(0.1, 2.5), each(0.5, 40.0), each(-0.6, 0.6));
    let racing = rng.random_range(0..joints);
    let factor = rng.random_range(1.5..4.0);
    let mut goal = random_q(world.chain(), rng);
    let mut commands: Vec<Command> = Vec::with_capacity(n);
    let mut before = start.to_vec();
    for period in 0..n {
        let t = period as f64 * PERIOD_SECS;
        let sines = |speed: f64| (0..joints).map(|i| start[i] + amplitude[i] * (speed * frequency[i] * t).sin()).collect();
        let q: Option<Vec<f64>> = match kind {
            Kind::Noise => Some((0..joints).map(|i| start[i] + rng.random_range(-1.0..1.0) * amplitude[i]).collect()),
            Kind::Jumps => {
                if rng.random_bool(0.005) {
                    goal = random_q(world.chain(), rng);
                }
                Some(goal.clone())
            }
            Kind::Sines => Some(sines(1.0)),
            Kind::NotNumbers => {
                let mut q: Vec<f64> = sines(0.1);
                if rng.random_bool(0.05) {
                    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300][rng.random_range(0..4)];
                    q[rng.random_range(0..joints)] = bad;
                }
                if rng.random_bool(0.01) {
                    q.truncate(rng.random_range(0..joints));
                }
                Some(q)
            }
            Kind::Frozen if period % 300 >= 150 => Some(before.clone()),
            Kind::Frozen => Some(sines(0.05)),
            Kind::Drift => Some((0..joints).map(|i| start[i] + drift[i] * t).collect()),
            Kind::Silent => (period % 250 < 200).then(|| sines(0.05)),
            Kind::Racing => {
                let mut q = start.to_vec();
                let (low, high) = (limits[racing].lower.max(-3.0), limits[racing].upper.min(3.0));
                let gone = factor * limits[racing].velocity * t / (high - low);
                let triangle = |share: f64| 1.0 - (1.0 - share.rem_euclid(2.0)).abs();
                let begin = (start[racing] - low) / (high - low);
                q[racing] = low + (high - low) * triangle(begin + gone);
                Some(q)
            }
        };
        let command = q.map(|q| {
            let dq = (0..q.len().min(joints)).map(|i| (q[i] - before[i]) / PERIOD_SECS).collect();
            if q.len() == joints && q.iter().all(|v| v.is_finite()) {
                before.clone_from(&q);
            }
            (q, dq)
        });
        commands.push(command);
    }
    commands
}

/// Speed of the one joint that is asked to be too fast, share of its limit, over the periods in which source and joint go the same
/// way, the joint has had time to reach its speed and has room to keep it, and nothing is near.
fn racing_share(log: &[Vec<f64>], commands: &[Command], is_near: &[bool], chain: &sfg_kinematics::Chain) -> Option<f64> {
    let asked = |period: usize| commands[period].as_ref().map(|(q, _)| q.as_slice());
    let joint = (0..chain.n_joints()).find(|i| asked(0).zip(asked(10)).is_some_and(|(a, b)| a[*i] != b[*i]))?;
    let limits = &chain.limits[joint];
    let settle = (2.5 * (limits.velocity / limits.acceleration + limits.acceleration / limits.jerk) / PERIOD_SECS) as usize;
    let mut same = 0;
    let mut sum = 0.0;
    let mut n = 0;
    for period in 1..commands.len() {
        let source = asked(period)?[joint] - asked(period - 1)?[joint];
        let ahead = asked(period)?[joint] - log[period + 2][joint];
        let q = log[period + 2][joint];
        let room = if source > 0.0 { limits.upper - q } else { q - limits.lower };
        let braking = 0.5 * limits.velocity * limits.velocity / limits.acceleration;
        let is_free = source * ahead > 0.0 && ahead.abs() > braking && room > 2.0 * braking;
        same = if is_free { same + 1 } else { 0 };
        if is_near[period] {
            same = 0;
        }
        if same > settle {
            sum += (log[period + 3][joint] - log[period + 2][joint]).abs() / PERIOD_SECS / limits.velocity;
            n += 1;
        }
    }
    (n > 20).then(|| sum / f64::from(n))
}

fn print_hostile(all: &[Tried], options: &BenchOptions) {
    let n_broken = all.iter().filter(|one| !one.breaches.is_empty() || one.exact_contact.is_some()).count();
    let (low, high) = wilson_interval(n_broken, all.len());
    say!("{} hostile trajectories of {} s at 1 kHz, seed {}", all.len(), options.secs, options.seed);
    say!(
        "broken limits (position, velocity, acceleration, jerk, workspace, distance): {n_broken} (95 % interval {:.3} to {:.3} %)",
        100.0 * low,
        100.0 * high
    );
    for one in all.iter().filter(|one| !one.breaches.is_empty() || one.exact_contact.is_some()).take(5) {
        say!("  trial {} ({:?}): {:?} {:?}", one.trial, one.kind, one.breaches.first(), one.exact_contact);
    }
    let periods = options.secs / PERIOD_SECS;
    let quantile = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values.get((share * values.len().saturating_sub(1) as f64).round() as usize).copied().unwrap_or(f64::NAN)
    };
    for kind in KINDS {
        let of_kind: Vec<&Tried> = all.iter().filter(|one| one.kind == kind).collect();
        if of_kind.is_empty() {
            continue;
        }
        let changed = of_kind.iter().map(|one| one.n_interventions as f64).sum::<f64>() / of_kind.len() as f64 / periods;
        let median = quantile(of_kind.iter().map(|one| one.median_micros).collect(), 0.5);
        let p99 = quantile(of_kind.iter().map(|one| one.p99_micros).collect(), 0.5);
        say!(
            "  {kind:<11?} {:>6} trajectories, {:>5.1} % of set points changed, {median:>6.1} us median, {p99:>6.1} us p99",
            of_kind.len(),
            100.0 * changed
        );
    }
    let shares: Vec<f64> = all.iter().filter_map(|one| one.speed_share).collect();
    if !shares.is_empty() {
        say!(
            "speed where the source is too fast: median {:.3} of the limit, 5th percentile {:.3} ({} trajectories)",
            quantile(shares.clone(), 0.5),
            quantile(shares.clone(), 0.05),
            shares.len()
        );
    }
}

fn print_planned(all: &[Planned]) {
    let planned: Vec<&Planned> = all.iter().filter(|one| one.why.as_deref() != Some("no plan")).collect();
    say!("{} planned trajectories", planned.len());
    for tried in 0..SPEEDS_TRIED {
        let speed = SLOWER.powi(tried as i32);
        let n = planned.iter().filter(|one| one.speed.is_some_and(|at| (at - speed).abs() < 1e-9)).count();
        say!("  pass unchanged at {:.2} of the speed limits: {n}", speed);
    }
    let largest = planned.iter().map(|one| one.largest_change_rad).fold(0.0, f64::max);
    say!("  largest change of a position that passed: {largest:.1e} rad");
    for one in planned.iter().filter(|one| one.speed.is_none()).take(5) {
        say!("  trial {} never passed: {}", one.trial, one.why.as_deref().unwrap_or("-"));
    }
    for one in planned.iter().filter(|one| one.speed.is_some_and(|speed| speed < 1.0)).take(3) {
        say!("  trial {} was slowed down: {}", one.trial, one.why.as_deref().unwrap_or("-"));
    }
}
