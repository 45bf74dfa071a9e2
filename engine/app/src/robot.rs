//! `sfg robot info|ik|reach` and `sfg ik bench`: what a robot can do, without a scenario.

use crate::assets::Assets;
use crate::check::BadInput;
use crate::reach::{ReachCommand, reach};
use crate::say::say;
use crate::statistics::wilson_interval;
use anyhow::{Context as _, Result};
use nalgebra::{Translation3, UnitQuaternion};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, JointKind, JointSource, RobotModel, Tree, joints_at_limit};
use sfg_types::layout::PoseLayout;
use sfg_types::{HandSide, Pose};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Robots by themselves.
#[derive(clap::Subcommand)]
pub(crate) enum RobotCommand {
    /// Lists links, joints with their limits, arms and cameras.
    Info {
        /// Name of a robot in the assets, or a URDF file.
        #[arg(default_value = "curi")]
        robot: String,
    },
    /// Joint angles of an arm whose palm is at a pose; obstacles are left out.
    Ik(IkOptions),
    /// The reachability map of an arm: build, at, slice, check.
    #[command(subcommand)]
    Reach(ReachCommand),
    /// Writes a URDF whose collision shapes are balls that cover the robot's own shapes, meshes included.
    Spheres(crate::spheres::Options),
}

/// Inverse kinematics.
#[derive(clap::Subcommand)]
pub(crate) enum IkCommand {
    /// Solves random poses that the arm reaches, from random configurations, and prints how many and how fast.
    Bench(BenchOptions),
}

#[derive(clap::Args)]
pub(crate) struct IkOptions {
    #[command(flatten)]
    chain: ChainOptions,
    #[command(flatten)]
    pose: PoseOptions,
    /// Seed of the random starts.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// Where the tip shall be.
#[derive(clap::Args)]
pub(crate) struct PoseOptions {
    /// Place of the tip in the base link, metres.
    #[arg(long, num_args = 3, required = true, allow_negative_numbers = true, value_names = ["X", "Y", "Z"])]
    xyz_m: Vec<f64>,
    /// Its turn: roll, pitch and yaw about the fixed axes, degrees.
    #[arg(long, num_args = 3, allow_negative_numbers = true, value_names = ["ROLL", "PITCH", "YAW"], default_values_t = [0.0, 0.0, 0.0])]
    rpy_deg: Vec<f64>,
}

impl PoseOptions {
    pub(crate) fn pose(&self) -> Result<Pose> {
        let ([x, y, z], [roll, pitch, yaw]) = (three(&self.xyz_m), three(&self.rpy_deg));
        if [x, y, z, roll, pitch, yaw].iter().any(|value| !value.is_finite()) {
            return Err(BadInput("--xyz-m and --rpy-deg take finite numbers".to_owned()).into());
        }
        let turn = UnitQuaternion::from_euler_angles(roll.to_radians(), pitch.to_radians(), yaw.to_radians());
        Ok(Pose::from_parts(Translation3::new(x, y, z), turn))
    }
}

#[derive(clap::Args)]
pub(crate) struct BenchOptions {
    #[command(flatten)]
    chain: ChainOptions,
    /// Poses.
    #[arg(long, default_value_t = 10_000)]
    n: usize,
    /// Seed of poses and starts.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// A solution that took longer counts as none.
    #[arg(long, default_value_t = 5.0)]
    within_ms: f64,
    /// Writes every pose's figures to this file.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

/// Which joints, from where to where.
#[derive(clap::Args)]
pub(crate) struct ChainOptions {
    /// Name of a robot in the assets, or a URDF file together with --base and --tip.
    #[arg(long, default_value = "curi")]
    pub(crate) robot: String,
    /// Arm of a robot in the assets.
    #[arg(long, default_value = "left", value_parser = ["left", "right"])]
    pub(crate) arm: String,
    /// First link of the chain.
    #[arg(long, requires = "tip")]
    base: Option<String>,
    /// Last link of the chain.
    #[arg(long, requires = "base")]
    pub(crate) tip: Option<String>,
}

enum Robot {
    Known(Box<RobotModel>),
    Urdf(Tree),
}

impl Robot {
    fn load(assets: &Assets, robot: &str) -> Result<Self> {
        if let Some(path) = assets.robots.get(robot) {
            return Ok(Self::Known(Box::new(RobotModel::load(path).map_err(|error| BadInput(error.to_string()))?)));
        }
        let path = Path::new(robot);
        if !path.is_file() {
            let known = || assets.robots.keys().map(String::as_str);
            let near = sfg_tree::nearest(robot, known()).map(|near| format!("; did you mean {near:?}?")).unwrap_or_default();
            let list = known().collect::<Vec<_>>().join(", ");
            return Err(BadInput(format!("{robot:?} is neither a robot of the assets ({list}) nor a file{near}")).into());
        }
        Ok(Self::Urdf(Tree::load(path).map_err(|error| BadInput(error.to_string()))?))
    }

    fn tree(&self) -> &Tree {
        match self {
            Self::Known(model) => &model.tree,
            Self::Urdf(tree) => tree,
        }
    }
}

/// The chain that is asked for, and a configuration in it to begin from.
pub(crate) fn chain(assets: &Assets, options: &ChainOptions) -> Result<(Chain, Vec<f64>)> {
    let robot = Robot::load(assets, &options.robot)?;
    let rest_q = match &robot {
        Robot::Known(model) => model.home_q.clone(),
        Robot::Urdf(tree) => vec![0.0; tree.n_q()],
    };
    let chain = match (&robot, &options.base, &options.tip) {
        (_, Some(base), Some(tip)) => {
            Chain::between(robot.tree(), base, tip, &rest_q).map_err(|error| BadInput(error.to_string()))?
        }
        (Robot::Known(model), ..) => {
            let side = if options.arm == "right" { HandSide::Right } else { HandSide::Left };
            return Ok((model.arm_chain(side).clone(), model.arm(side).home_q.clone()));
        }
        (Robot::Urdf(_), ..) => {
            return Err(BadInput(
                "a URDF has no arms by name: give --base and --tip; `sfg robot info` lists the links".to_owned(),
            )
            .into());
        }
    };
    if chain.n_joints() == 0 {
        return Err(BadInput("nothing moves between --base and --tip".to_owned()).into());
    }
    let middle = chain.middle();
    Ok((chain, middle))
}

/// Runs a command about a robot.
pub(crate) fn robot(assets: &Assets, command: &RobotCommand) -> Result<ExitCode> {
    match command {
        RobotCommand::Info { robot } => info(&Robot::load(assets, robot)?),
        RobotCommand::Ik(options) => return solve(assets, options),
        RobotCommand::Reach(command) => return reach(assets, command),
        RobotCommand::Spheres(options) => return crate::spheres::run(options),
    }
    Ok(ExitCode::SUCCESS)
}

fn info(robot: &Robot) {
    let tree = robot.tree();
    let mass_kg: f64 = tree.links.iter().map(|link| link.inertial.mass_kg).sum();
    let n_shapes: usize = tree.links.iter().map(|link| link.collision.len()).sum();
    let links = tree.links.len();
    say!("{links} links, {} joints that move by themselves, {mass_kg:.1} kg, {n_shapes} collision shapes", tree.n_q());
    say!("");
    say!("{:<32} {:<10} {:>9} {:>9} {:>8} {:>8}  moves", "joint", "kind", "lower", "upper", "speed", "effort");
    for joint in tree.joints.iter().filter(|joint| joint.kind != JointKind::Fixed) {
        let kind = match joint.kind {
            JointKind::Prismatic => "prismatic",
            _ => "revolute",
        };
        let follows = match joint.source {
            JointSource::Mimic { q_idx, multiplier, .. } => format!(" = {multiplier:.3} x {}", tree.q_names[q_idx]),
            _ => String::new(),
        };
        say!(
            "{:<32} {kind:<10} {:>9.4} {:>9.4} {:>8.3} {:>8.1}  {}{follows}",
            joint.name,
            joint.lower,
            joint.upper,
            joint.velocity,
            joint.effort,
            tree.links[joint.child_idx].name
        );
    }
    let Robot::Known(model) = robot else { return };
    say!("");
    for arm in [&model.left, &model.right] {
        let at = arm.chain.fk(&arm.home_q).translation;
        let manipulability = arm.chain.manipulability(&arm.home_q);
        say!(
            "{} arm: {} joints to {}, at home ({:.3}, {:.3}, {:.3}) m, manipulability {manipulability:.3}",
            arm.side.name(),
            arm.chain.n_joints(),
            arm.tip_link,
            at.x,
            at.y,
            at.z
        );
    }
    for camera in &model.cameras {
        let lens = &camera.intrinsics;
        let mount = &tree.links[camera.mount_idx].name;
        say!("camera {}: {} x {} pixels, focal length {:.0}, on {mount}", camera.name, lens.width, lens.height, lens.fx);
    }
}

fn solve(assets: &Assets, options: &IkOptions) -> Result<ExitCode> {
    let (chain, seed_q) = chain(assets, &options.chain)?;
    let target = options.pose.pose()?;
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    match IkSolver::solve(&chain, &target, &seed_q, &IkSettings::default(), &mut rng) {
        IkOutcome::Solved { q, iterations } => {
            say!("reached after {iterations} steps, manipulability {:.3}", chain.manipulability(&q));
            for ((name, value), limits) in chain.joint_names.iter().zip(&q).zip(&chain.limits) {
                let spare = (value - limits.lower).min(limits.upper - value);
                say!("{name:<24} {value:>9.5} rad  {:>8.2} deg, {:.2} rad to its limit", value.to_degrees(), spare);
            }
            Ok(ExitCode::SUCCESS)
        }
        IkOutcome::Failed { best_q, position_miss_m, rotation_miss_rad } => {
            let miss = miss_in_words(&chain, &best_q, position_miss_m, rotation_miss_rad);
            Err(BadInput(format!("the pose is not reached; the nearest misses it by {miss}")).into())
        }
    }
}

/// How far a configuration is from its target, and which joints stand at a limit.
pub(crate) fn miss_in_words(chain: &Chain, q: &[f64], position_miss_m: f64, rotation_miss_rad: f64) -> String {
    let at_limit = joints_at_limit(chain, q);
    let at_limit = if at_limit.is_empty() { String::new() } else { format!(", with {} at the limit", at_limit.join(", ")) };
    format!("{:.1} mm and {:.1} deg{at_limit}", 1000.0 * position_miss_m, rotation_miss_rad.to_degrees())
}

fn three(values: &[f64]) -> [f64; 3] {
    // The command line takes three.
    std::array::from_fn(|idx| values.get(idx).copied().unwrap_or(0.0))
}

/// Figures of one pose.
#[derive(Serialize)]
struct Tried {
    /// Where the arm reaches the pose, and the pose: for a check of the forward kinematics by another program.
    q: Vec<f64>,
    base_from_tip: PoseLayout,
    micros: f64,
    is_solved: bool,
    /// Over all starts.
    iterations: usize,
    /// How far the solution's tip is from the target by the slow, exact way.
    position_miss_m: f64,
    rotation_miss_rad: f64,
}

/// Solves random poses.
pub(crate) fn bench(assets: &Assets, IkCommand::Bench(options): &IkCommand) -> Result<ExitCode> {
    if options.n == 0 {
        return Err(BadInput("--n 0 measures nothing; expected at least 1".to_owned()).into());
    }
    let (chain, _) = chain(assets, &options.chain)?;
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let settings = IkSettings::default();
    let mut all = Vec::with_capacity(options.n);
    for _ in 0..options.n {
        let (there, start) = (random_q(&chain, &mut rng), random_q(&chain, &mut rng));
        let target = chain.fk(&there);
        let begun = Instant::now();
        let outcome = IkSolver::solve(&chain, &target, &start, &settings, &mut rng);
        let micros = 1e6 * begun.elapsed().as_secs_f64();
        let base_from_tip = PoseLayout::from(target);
        all.push(match outcome {
            IkOutcome::Solved { q, iterations } => {
                let miss = target.inverse() * chain.fk(&q);
                let (position_miss_m, rotation_miss_rad) = (miss.translation.vector.norm(), miss.rotation.angle());
                let near = 1.01;
                let is_solved = chain.is_inside_limits(&q, 1e-9)
                    && position_miss_m <= near * settings.position_tolerance_m
                    && rotation_miss_rad <= near * settings.rotation_tolerance_rad;
                Tried { q: there, base_from_tip, micros, is_solved, iterations, position_miss_m, rotation_miss_rad }
            }
            IkOutcome::Failed { position_miss_m, rotation_miss_rad, .. } => {
                Tried { q: there, base_from_tip, micros, is_solved: false, iterations: 0, position_miss_m, rotation_miss_rad }
            }
        });
    }
    print(&chain, &all, options);
    if let Some(path) = &options.json {
        let text = serde_json::to_string_pretty(&all)?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print(chain: &Chain, all: &[Tried], options: &BenchOptions) {
    let n_solved = all.iter().filter(|one| one.is_solved).count();
    let n_in_time = all.iter().filter(|one| one.is_solved && one.micros <= 1000.0 * options.within_ms).count();
    let percent = |n: usize| 100.0 * n as f64 / all.len() as f64;
    let (low, high) = wilson_interval(n_in_time, all.len());
    let mut micros: Vec<f64> = all.iter().map(|one| one.micros).collect();
    micros.sort_by(f64::total_cmp);
    let quantile = |share: f64| micros[((share * (micros.len() - 1) as f64).round()) as usize];
    let mean = micros.iter().sum::<f64>() / micros.len() as f64;
    say!(
        "{} joints, {} poses that the arm reaches, seed {}, tolerance 1e-5 m and 1e-5 rad",
        chain.n_joints(),
        all.len(),
        options.seed
    );
    say!(
        "solved within {} ms: {n_in_time} ({:.2} %, 95 % interval {:.2} to {:.2} %); without that bound {n_solved} ({:.2} %)",
        options.within_ms,
        percent(n_in_time),
        100.0 * low,
        100.0 * high,
        percent(n_solved)
    );
    say!(
        "time each: mean {mean:.1} us, median {:.1}, 95th percentile {:.1}, 99th {:.1}, longest {:.1}",
        quantile(0.5),
        quantile(0.95),
        quantile(0.99),
        quantile(1.0)
    );
}
