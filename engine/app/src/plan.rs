//! `sfg plan bench`: how many motion planning problems are solved, how fast, and whether the paths stand a closer look.

use crate::check::BadInput;
use crate::say::say;
use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};
use sfg_kinematics::{Chain, Shape, Srdf, Tree};
use sfg_planning::{
    CollisionModel, CollisionSettings, Obstacle, PlanOutcome, Planner as _, RawPath, RrtConnect, SelfPairs, verify_tree_exact,
};
use sfg_types::Pose;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Motion planning.
#[derive(clap::Subcommand)]
pub(crate) enum PlanCommand {
    /// Solves files of problems such as MotionBenchMaker's and prints times, path lengths and how many stand a closer check.
    Bench(BenchOptions),
}

#[derive(clap::Args)]
pub(crate) struct BenchOptions {
    /// Files of problems: JSON with start, goals and obstacles.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The robot's URDF; its collision shapes are covered by balls.
    #[arg(long)]
    urdf: PathBuf,
    /// The robot's SRDF: the group's chain and the pairs of links that are not checked.
    #[arg(long)]
    srdf: PathBuf,
    /// Position limits in place of the URDF's: YAML as MoveIt's `joint_limits.yaml`, min_position and max_position.
    #[arg(long, value_name = "FILE")]
    limits: Option<PathBuf>,
    /// Which group of the SRDF moves.
    #[arg(long, default_value = "panda_arm")]
    group: String,
    /// Solves each problem so many times; the shortest time counts.
    #[arg(long, default_value_t = 5)]
    repeats: usize,
    /// Seed of the planner.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Writes every problem's figures to this file.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

#[derive(Deserialize)]
struct ProblemFile {
    set: String,
    problems: Vec<Problem>,
}

#[derive(Deserialize)]
struct Problem {
    index: usize,
    start: Vec<f64>,
    goals: Vec<Vec<f64>>,
    obstacles: Vec<ProblemObstacle>,
}

#[derive(Deserialize)]
struct ProblemObstacle {
    id: String,
    #[serde(rename = "type")]
    kind: String,
    dims: Vec<f64>,
    pos: [f64; 3],
    quat_xyzw: [f64; 4],
}

/// Figures of one problem.
#[derive(Serialize)]
struct Solved {
    set: String,
    index: usize,
    outcome: &'static str,
    plan_micros: f64,
    simplify_micros: f64,
    accept_micros: f64,
    iterations: usize,
    length_rad: f64,
    simplified_rad: f64,
    /// Whether the first path was accepted; if not, the planner searches again with closer checks.
    accepted_at_once: bool,
    /// Everything until a path is accepted.
    whole_micros: f64,
    /// The planner's answer is free at 512 checks for each radian in double precision, one by one, by another formula.
    is_free: bool,
    /// What the answer touches at 512 checks for each radian by exact geometry: the URDF's shapes and the obstacles by parry.
    exact_contact: Option<String>,
}

#[derive(Deserialize)]
struct LimitsFile {
    joint_limits: BTreeMap<String, PositionLimits>,
}

/// Speeds and accelerations, which MoveIt keeps here, too, are passed over.
#[derive(Deserialize)]
struct PositionLimits {
    min_position: Option<f64>,
    max_position: Option<f64>,
}

/// The robot of a run.
struct Robot {
    tree: Tree,
    disabled_pairs: BTreeSet<(String, String)>,
    rest_q: Vec<f64>,
    // Without obstacles.
    empty: CollisionModel,
}

/// Checks for each radian of the closer look.
const CHECKS_PER_RAD: f64 = 512.0;

pub(crate) fn run(command: &PlanCommand) -> Result<ExitCode> {
    let PlanCommand::Bench(options) = command;
    let robot = robot(options)?;
    let mut all = Vec::new();
    for file in &options.files {
        let problems = read(file)?;
        for problem in &problems.problems {
            all.push(solve(&robot, &problems.set, problem, options).with_context(|| file.display().to_string())?);
        }
    }
    print(&all, options);
    if let Some(path) = &options.json {
        let text = serde_json::to_string_pretty(&all)?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn robot(options: &BenchOptions) -> Result<Robot> {
    let tree = Tree::load(&options.urdf).map_err(|error| BadInput(error.to_string()))?;
    let srdf = Srdf::load(&options.srdf).map_err(|error| BadInput(error.to_string()))?;
    let mut chain = chain_of(&tree, &srdf, options)?;
    if let Some(path) = &options.limits {
        set_limits(&mut chain, path)?;
    }
    let settings = CollisionSettings { arm_excess_m: 0.0, hand_excess_m: 0.0, clearance_m: 0.0, self_clearance_m: 0.0 };
    let pairs = SelfPairs::AllBut(srdf.disabled_pairs.clone());
    let rest_q = vec![0.0; tree.n_q()];
    let empty =
        CollisionModel::of_tree(&tree, chain, None, &rest_q, pairs, settings).map_err(|error| BadInput(error.to_string()))?;
    Ok(Robot { tree, disabled_pairs: srdf.disabled_pairs, rest_q, empty })
}

fn set_limits(chain: &mut Chain, path: &Path) -> Result<()> {
    let wrong = |what: String| BadInput(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| BadInput(format!("cannot read {}: {error}", path.display())))?;
    let file: LimitsFile = serde_saphyr::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    for (name, limits) in chain.joint_names.iter().zip(&mut chain.limits) {
        let found = file.joint_limits.get(name).and_then(|one| Some((one.min_position?, one.max_position?)));
        let (lower, upper) =
            found.ok_or_else(|| wrong(format!("joint_limits.{name}: expected min_position and max_position, radians")))?;
        if !lower.is_finite() || !upper.is_finite() || lower > upper {
            return Err(wrong(format!("joint_limits.{name}: {lower} to {upper} is no range")).into());
        }
        (limits.lower, limits.upper) = (lower, upper);
    }
    Ok(())
}

fn chain_of(tree: &Tree, srdf: &Srdf, options: &BenchOptions) -> Result<Chain> {
    let known = || srdf.groups.iter().map(|group| group.name.as_str()).collect::<Vec<_>>().join(", ");
    let wrong = |what: String| BadInput(format!("{}: {what}", options.srdf.display()));
    let group = srdf
        .group(&options.group)
        .ok_or_else(|| wrong(format!("no group is called {:?}; its groups are {}", options.group, known())))?;
    let (base, tip) = group.chain.as_ref().ok_or_else(|| wrong(format!("group {:?} has no <chain>", options.group)))?;
    Ok(Chain::between(tree, base, tip, &vec![0.0; tree.n_q()]).map_err(|error| wrong(error.to_string()))?)
}

fn read(path: &Path) -> Result<ProblemFile> {
    let text = std::fs::read_to_string(path).map_err(|error| BadInput(format!("cannot read {}: {error}", path.display())))?;
    Ok(serde_json::from_str(&text).map_err(|error| BadInput(format!("{}: {error}", path.display())))?)
}

fn obstacle(problem: &ProblemObstacle) -> Result<Obstacle> {
    let wrong = |what: String| BadInput(format!("obstacle {:?}: {what}", problem.id));
    let shape = match (problem.kind.as_str(), problem.dims.as_slice()) {
        ("box", [x, y, z]) => Shape::Cuboid { half_extents_m: sfg_types::Vector::new(*x, *y, *z) / 2.0 },
        ("cylinder", [height, radius]) => Shape::Cylinder { radius_m: *radius, half_length_m: height / 2.0 },
        ("sphere", [radius]) => Shape::Sphere { radius_m: *radius },
        (kind, dims) => {
            return Err(wrong(format!(
                "type {kind:?} with {} dims; expected box with 3, cylinder with 2 or sphere with 1",
                dims.len()
            ))
            .into());
        }
    };
    let [x, y, z, w] = problem.quat_xyzw;
    let rotation = nalgebra::Quaternion::new(w, x, y, z);
    if (rotation.norm() - 1.0).abs() > 1e-3 {
        return Err(wrong(format!("quat_xyzw has the length {:.3}; expected 1", rotation.norm())).into());
    }
    let pose_in_base =
        Pose::from_parts(sfg_types::Vector::from(problem.pos).into(), nalgebra::UnitQuaternion::from_quaternion(rotation));
    Ok(Obstacle { name: problem.id.clone(), shape, pose_in_base })
}

fn solve(robot: &Robot, set: &str, problem: &Problem, options: &BenchOptions) -> Result<Solved> {
    let empty = &robot.empty;
    let n = empty.chain().n_joints();
    if problem.start.len() != n || problem.goals.iter().any(|goal| goal.len() != n) {
        return Err(BadInput(format!("problem {}: expected {n} joint values in start and goals", problem.index)).into());
    }
    let obstacles = problem.obstacles.iter().map(obstacle).collect::<Result<Vec<_>>>()?;
    let mut collision = empty.clone();
    collision.set_world(&obstacles, None);
    let planner = RrtConnect::default();
    let mut solved = Solved {
        set: set.to_owned(),
        index: problem.index,
        outcome: "solved",
        plan_micros: f64::INFINITY,
        simplify_micros: f64::INFINITY,
        accept_micros: f64::INFINITY,
        iterations: 0,
        length_rad: 0.0,
        simplified_rad: 0.0,
        accepted_at_once: false,
        whole_micros: f64::INFINITY,
        is_free: false,
        exact_contact: None,
    };
    let mut found = Vec::new();
    for _ in 0..options.repeats.max(1) {
        let step_rad = planner.settings.edge_step_rad;
        let begun = Instant::now();
        let raw = match planner.search(&collision, &problem.start, &problem.goals, step_rad, options.seed) {
            Ok(raw) => raw,
            Err(PlanOutcome::StartInCollision { .. }) => return Ok(Solved { outcome: "start in collision", ..solved }),
            Err(PlanOutcome::GoalInCollision { .. }) => return Ok(Solved { outcome: "goal in collision", ..solved }),
            Err(PlanOutcome::OutsideLimits { .. }) => return Ok(Solved { outcome: "outside limits", ..solved }),
            Err(_) => RawPath { path: Vec::new(), iterations: planner.settings.restart_after },
        };
        solved.plan_micros = solved.plan_micros.min(begun.elapsed().as_secs_f64() * 1e6);
        (solved.iterations, solved.length_rad) = (raw.iterations, length(&raw.path));
        let begun = Instant::now();
        let path = planner.simplify(&collision, raw.path, step_rad, options.seed);
        solved.simplify_micros = solved.simplify_micros.min(begun.elapsed().as_secs_f64() * 1e6);
        solved.simplified_rad = length(&path);
        let begun = Instant::now();
        solved.accepted_at_once = !path.is_empty() && planner.accepts(&collision, &path);
        solved.accept_micros = solved.accept_micros.min(begun.elapsed().as_secs_f64() * 1e6);
        let begun = Instant::now();
        let outcome = planner.plan(&collision, &problem.start, &problem.goals, options.seed);
        solved.whole_micros = solved.whole_micros.min(begun.elapsed().as_secs_f64() * 1e6);
        match outcome {
            PlanOutcome::Found(path) => found = path,
            _ => solved.outcome = "not found",
        }
    }
    solved.is_free = !found.is_empty() && independently_free(&collision, &found);
    let (pairs, step_rad) = (Some(&robot.disabled_pairs), 1.0 / CHECKS_PER_RAD);
    let contact = verify_tree_exact(&robot.tree, None, &robot.rest_q, &collision, pairs, &found, step_rad);
    solved.exact_contact = contact.map(|contact| contact.to_string());
    Ok(solved)
}

/// One by one in double precision.
fn independently_free(collision: &CollisionModel, path: &[Vec<f64>]) -> bool {
    path.windows(2).all(|pair| {
        let n = (length(pair) * CHECKS_PER_RAD).ceil().max(1.0) as usize;
        (0..=n).all(|i| {
            let share = i as f64 / n as f64;
            let q: Vec<f64> = pair[0].iter().zip(&pair[1]).map(|(a, b)| a + share * (b - a)).collect();
            collision.is_free(&q)
        })
    })
}

fn length(path: &[Vec<f64>]) -> f64 {
    let gap = |pair: &[Vec<f64>]| pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    path.windows(2).map(gap).sum()
}

fn print(all: &[Solved], options: &BenchOptions) {
    let mut sets: Vec<&str> = all.iter().map(|one| one.set.as_str()).collect();
    sets.dedup();
    say!(
        "set                        solved   free   at once       plan us   simplify us     accept us      whole us   (median / p95)"
    );
    for set in sets.into_iter().map(Some).chain([None]) {
        let of_set: Vec<&Solved> = all.iter().filter(|one| set.is_none_or(|set| one.set == set)).collect();
        let solved: Vec<&&Solved> = of_set.iter().filter(|one| one.outcome == "solved").collect();
        let pair = |of: &dyn Fn(&Solved) -> f64| {
            let mut values: Vec<f64> = solved.iter().map(|one| of(one)).collect();
            values.sort_by(f64::total_cmp);
            let at =
                |share: f64| values.get((share * (values.len().max(1) - 1) as f64).round() as usize).copied().unwrap_or(f64::NAN);
            format!("{:.0} / {:.0}", at(0.5), at(0.95))
        };
        say!(
            "{:24} {:>4}/{:<4} {:>6} {:>8}  {:>13} {:>13} {:>13} {:>13}",
            set.unwrap_or("all"),
            solved.len(),
            of_set.len(),
            solved.iter().filter(|one| one.is_free).count(),
            solved.iter().filter(|one| one.accepted_at_once).count(),
            pair(&|one| one.plan_micros),
            pair(&|one| one.simplify_micros),
            pair(&|one| one.accept_micros),
            pair(&|one| one.whole_micros)
        );
    }
    let inside: Vec<&Solved> = all.iter().filter(|one| matches!(one.outcome, "solved" | "not found")).collect();
    let solved = inside.iter().filter(|one| one.outcome == "solved").count();
    let fails = inside.iter().filter(|one| one.exact_contact.is_some()).count();
    let limits = options.limits.as_ref().unwrap_or(&options.urdf);
    say!(
        "exact geometry: of {} problems with free ends inside the limits of {} {solved} are solved; {fails} of these paths fail a \
         check by parry at {CHECKS_PER_RAD} for each radian, obstacles and self pairs",
        inside.len(),
        limits.display()
    );
    for one in all {
        if one.outcome != "solved" {
            say!("{} {}: {}", one.set, one.index, one.outcome);
        } else if !one.is_free {
            say!("{} {}: no path stood the closer look", one.set, one.index);
        }
        if let Some(contact) = &one.exact_contact {
            say!("{} {}: by exact geometry {contact}", one.set, one.index);
        }
    }
}
