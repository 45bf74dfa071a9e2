//! `sfg robot reach build|at|slice|check`: the reachability map of an arm.

use crate::assets::Assets;
use crate::check::BadInput;
use crate::robot::{ChainOptions, PoseOptions, chain, miss_in_words};
use crate::say::say;
use crate::statistics::wilson_interval;
use anyhow::{Context as _, Result};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{Quaternion, Unit, Vector3, Vector4};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::reach::{ReachBuild, ReachMap, ReachSettings};
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, RobotModel};
use sfg_render::Picture;
use sfg_types::{HandSide, Point, Pose};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Where an arm reaches.
#[derive(clap::Subcommand)]
pub(crate) enum ReachCommand {
    /// Builds the map of an arm, a minute of work; goes on where an earlier build was stopped.
    Build(BuildOptions),
    /// Says whether the arm reaches a palm pose; obstacles are left out.
    At(AtOptions),
    /// Draws at which places of one height the palm arrives with how many of the rotations.
    Slice(SliceOptions),
    /// Compares the map with inverse kinematics on random palm poses.
    Check(CheckOptions),
}

/// Which map of which arm.
#[derive(clap::Args)]
struct MapOptions {
    #[command(flatten)]
    chain: ChainOptions,
    /// The map's file; by default it lies beside the robot's description, where runs find it.
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
}

#[derive(clap::Args)]
pub(crate) struct BuildOptions {
    #[command(flatten)]
    map: MapOptions,
    /// Edge of a voxel, metres.
    #[arg(long, default_value_t = ReachSettings::default().resolution_m)]
    resolution_m: f64,
    /// Seed of the random starts.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads; the map is the same with any number.
    #[arg(long, default_value_t = std::thread::available_parallelism().map_or(1, usize::from))]
    jobs: usize,
}

#[derive(clap::Args)]
pub(crate) struct AtOptions {
    #[command(flatten)]
    map: MapOptions,
    #[command(flatten)]
    pose: PoseOptions,
}

#[derive(clap::Args)]
pub(crate) struct SliceOptions {
    #[command(flatten)]
    map: MapOptions,
    /// Height over the base link, metres.
    #[arg(long, allow_negative_numbers = true)]
    height_m: f64,
    /// The picture.
    #[arg(long, value_name = "PNG", default_value = "reach.png")]
    out: PathBuf,
}

#[derive(clap::Args)]
pub(crate) struct CheckOptions {
    #[command(flatten)]
    map: MapOptions,
    /// Palm poses, anywhere in the map's box and turned anyhow.
    #[arg(long, default_value_t = 10_000)]
    n: usize,
    /// Seed of the poses; the build never saw them, whatever its seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// The file where runs look for the map of a robot's arm.
pub(crate) fn beside(robot: &Path, side: HandSide) -> PathBuf {
    robot.with_extension(format!("{}.reach", side.name()))
}

/// The map that lies beside a robot's description.
///
/// A map that does not fit is refused rather than passed over: with it a run may decide otherwise than its user expects.
pub(crate) fn for_run(robot: &Path, model: &RobotModel, side: HandSide) -> Result<Option<ReachMap>> {
    let path = beside(robot, side);
    if !path.exists() {
        return Ok(None);
    }
    Ok(Some(ReachMap::load(&path, model.arm_chain(side)).map_err(|error| BadInput(error.to_string()))?))
}

/// Chain and file that are asked for.
fn asked(assets: &Assets, options: &MapOptions) -> Result<(Chain, PathBuf)> {
    let (chain, _) = chain(assets, &options.chain)?;
    let side = if options.chain.arm == "right" { HandSide::Right } else { HandSide::Left };
    let path = match (&options.map, assets.robots.get(&options.chain.robot), &options.chain.tip) {
        (Some(path), ..) => path.clone(),
        (None, Some(robot), None) => beside(robot, side),
        _ => return Err(BadInput("a chain by --base and --tip has no place for its map: give --map FILE".to_owned()).into()),
    };
    Ok((chain, path))
}

fn load(assets: &Assets, options: &MapOptions) -> Result<(Chain, ReachMap)> {
    let (chain, path) = asked(assets, options)?;
    if !path.exists() {
        let message = format!("there is no map {}; `sfg robot reach build` builds it", path.display());
        return Err(BadInput(message).into());
    }
    let map = ReachMap::load(&path, &chain).map_err(|error| BadInput(error.to_string()))?;
    Ok((chain, map))
}

/// Runs a command about reach.
pub(crate) fn reach(assets: &Assets, command: &ReachCommand) -> Result<ExitCode> {
    match command {
        ReachCommand::Build(options) => build(assets, options),
        ReachCommand::At(options) => at(assets, options),
        ReachCommand::Slice(options) => slice(assets, options),
        ReachCommand::Check(options) => check(assets, options),
    }
}

fn build(assets: &Assets, options: &BuildOptions) -> Result<ExitCode> {
    if !(0.02..=0.5).contains(&options.resolution_m) {
        let message = format!("--resolution-m {} is not between 0.02 and 0.5 m", options.resolution_m);
        return Err(BadInput(message).into());
    }
    let (chain, path) = asked(assets, &options.map)?;
    let settings = ReachSettings { resolution_m: options.resolution_m, seed: options.seed };
    let begun = Instant::now();
    let mut build = ReachBuild::new(&chain, &options.map.chain.robot, &options.map.chain.arm, &settings);
    let part = path.with_extension("reach-build");
    if part.exists() {
        match ReachBuild::resume(&part, &chain) {
            Ok(earlier) if earlier.is_like(&build) => {
                say!("goes on after pass {} of an earlier build", earlier.map().header().n_passes);
                build = earlier;
            }
            Ok(_) => say!("an earlier build with other settings is given up"),
            Err(error) => say!("an earlier build is given up: {error}"),
        }
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.jobs.max(1)).build().context("cannot start threads")?;
    let style = "{msg} {bar:30} {percent} %, {elapsed} gone";
    let style = ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(build.n_voxels() as u64).with_style(style);
    while !build.is_done() {
        let header = build.map().header();
        bar.set_message(format!("pass {}, {} cells reached", header.n_passes + 1, header.n_reached));
        bar.set_position(0);
        pool.install(|| build.pass(&chain, &|| bar.inc(1)));
        build.save(&part).map_err(|error| BadInput(error.to_string()))?;
    }
    bar.finish_and_clear();
    std::fs::rename(&part, &path).with_context(|| format!("cannot write {}", path.display()))?;
    let (map, bytes) = (build.map(), std::fs::metadata(&path).map_or(0, |metadata| metadata.len()));
    let share = 100.0 * map.header().n_reached as f64 / map.n_cells() as f64;
    say!(
        "{}: {} of {} cells reached ({share:.1} %), {:.1} MB, {} passes, {:.1} s",
        path.display(),
        map.header().n_reached,
        map.n_cells(),
        bytes as f64 / 1e6,
        map.header().n_passes,
        begun.elapsed().as_secs_f64()
    );
    Ok(ExitCode::SUCCESS)
}

fn at(assets: &Assets, options: &AtOptions) -> Result<ExitCode> {
    let (chain, map) = load(assets, &options.map)?;
    let verdict = map.verdict(&chain, &options.pose.pose()?);
    let score = verdict.score;
    match verdict.outcome {
        Some(IkOutcome::Solved { q, .. }) => {
            let angles: Vec<String> = q.iter().map(|value| format!("{value:.4}")).collect();
            say!("reachable, score {score:.2}: joints at {} rad", angles.join(", "));
            Ok(ExitCode::SUCCESS)
        }
        Some(IkOutcome::Failed { best_q, position_miss_m, rotation_miss_rad }) => {
            let miss = miss_in_words(&chain, &best_q, position_miss_m, rotation_miss_rad);
            Err(BadInput(format!("not reachable, score {score:.2}: the nearest misses it by {miss}")).into())
        }
        None => Err(BadInput("not reachable, score 0: no palm pose about it is".to_owned()).into()),
    }
}

/// Pixels of a voxel, and of the margin for words.
const PIXELS: usize = 12;
const MARGIN: usize = 28;

fn slice(assets: &Assets, options: &SliceOptions) -> Result<ExitCode> {
    let (chain, map) = load(assets, &options.map)?;
    let corners = map.box_in_base(&chain);
    let low = corners.iter().fold(Vector3::repeat(f64::INFINITY), |low, corner| low.inf(&corner.coords));
    let high = corners.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, corner| high.sup(&corner.coords));
    if !(low.z..=high.z).contains(&options.height_m) {
        let message = format!("--height-m {} lies outside the map, {:.2} to {:.2} m", options.height_m, low.z, high.z);
        return Err(BadInput(message).into());
    }
    // Seen from above: x, the robot's front, up; y, its left, to the left.
    let metres = map.header().resolution_m / PIXELS as f64;
    let [width, height] = [high.y - low.y, high.x - low.x].map(|length| (length / metres) as usize);
    let place = |idx: usize| {
        let (column, row) = (idx % width, idx / width);
        Point::new(high.x - (row as f64 + 0.5) * metres, high.y - (column as f64 + 0.5) * metres, options.height_m)
    };
    let shares: Vec<f64> = (0..width * height).map(|idx| map.share_at(&chain, &place(idx))).collect();
    // The ramp of depth pictures: yellow for all rotations, violet for few, black for none.
    let ramp: Vec<f32> = shares.iter().map(|share| if *share > 0.0 { 1.001 - *share as f32 } else { 0.0 }).collect();
    let mut picture = Picture::new(width, height + MARGIN, [255; 3]);
    picture.paste(&Picture::from_depth(width, height, &ramp, 0.0, 1.0), 0, 0);
    let pixel = |x: f64, y: f64| [(high.y - y) / metres, (high.x - x) / metres];
    for tenth in -30..=30_i32 {
        let (at, colour) = (f64::from(tenth) / 2.0, [110; 3]);
        picture.line(pixel(at, low.y), pixel(at, high.y), 1.0, colour);
        picture.line(pixel(low.x, at), pixel(high.x, at), 1.0, colour);
    }
    picture.fill_rectangle(0, height as i64, width as i64, MARGIN as i64, [255; 3]);
    picture.cross(pixel(0.0, 0.0), 8.0, [220, 20, 60]);
    let most = shares.iter().fold(0.0_f64, |most, share| most.max(*share));
    let words = format!(
        "{} {} arm, z = {:.2} m: up to {:.0} % of 48 rotations; x up, y left, lines 0.5 m, cross: base",
        map.header().robot,
        map.header().arm,
        options.height_m,
        100.0 * most
    );
    picture.text(4, height as i64 + 8, 1, [0; 3], &words);
    std::fs::write(&options.out, picture.png()?).with_context(|| format!("cannot write {}", options.out.display()))?;
    say!("{}: {words}", options.out.display());
    Ok(ExitCode::SUCCESS)
}

fn check(assets: &Assets, options: &CheckOptions) -> Result<ExitCode> {
    if options.n == 0 {
        return Err(BadInput("--n 0 measures nothing; expected at least 1".to_owned()).into());
    }
    let (chain, map) = load(assets, &options.map)?;
    let corners = map.box_in_base(&chain);
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let settings = IkSettings::default();
    let (mut n_reachable, mut n_false, mut n_missed, mut n_hopeless, mut n_wrongly_hopeless) = (0, 0, 0, 0, 0);
    let mut n_score_agrees = 0;
    let (mut verdict_us, mut score_us, mut exact_us) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..options.n {
        let pose = random_pose(&corners, &mut rng);
        let start_q = random_q(&chain, &mut rng);
        let exact = timed(&mut exact_us, || IkSolver::solve(&chain, &pose, &start_q, &settings, &mut rng));
        let is_reachable = matches!(exact, IkOutcome::Solved { .. });
        let score = timed(&mut score_us, || map.score(&chain, &pose));
        let verdict = timed(&mut verdict_us, || map.verdict(&chain, &pose));
        n_reachable += usize::from(is_reachable);
        n_false += usize::from(verdict.is_reachable() && !is_reachable);
        n_missed += usize::from(!verdict.is_reachable() && is_reachable);
        n_hopeless += usize::from(verdict.outcome.is_none());
        n_wrongly_hopeless += usize::from(verdict.outcome.is_none() && is_reachable);
        n_score_agrees += usize::from((score >= 0.5) == is_reachable);
    }
    let share = |what: &str, n: usize, of: usize| {
        let (low, high) = wilson_interval(n, of);
        let percent = 100.0 * n as f64 / of.max(1) as f64;
        say!("{what}: {n} of {of} ({percent:.2} %, 95 % interval {:.2} to {:.2} %)", 100.0 * low, 100.0 * high);
    };
    say!(
        "{} palm poses in the map's box, seed {}; inverse kinematics with {} starts",
        options.n,
        options.seed,
        settings.max_starts
    );
    share("reached by inverse kinematics", n_reachable, options.n);
    share("verdicts that agree", options.n - n_false - n_missed, options.n);
    share("falsely reachable, of all", n_false, options.n);
    share("falsely reachable, of the verdicts \"reachable\"", n_false, n_reachable + n_false - n_missed);
    share("falsely out of reach, of all", n_missed, options.n);
    share("hopeless though reached", n_wrongly_hopeless, n_hopeless);
    share("agree, by a score of 0.5 alone", n_score_agrees, options.n);
    for (what, micros) in [("score", &mut score_us), ("verdict", &mut verdict_us), ("inverse kinematics", &mut exact_us)] {
        micros.sort_by(f64::total_cmp);
        let quantile = |share: f64| micros[((share * (micros.len() - 1) as f64).round()) as usize];
        let mean = micros.iter().sum::<f64>() / micros.len() as f64;
        say!("{what}: median {:.2} us, 95th percentile {:.2}, mean {mean:.2}", quantile(0.5), quantile(0.95));
    }
    Ok(ExitCode::SUCCESS)
}

fn timed<T>(micros: &mut Vec<f64>, work: impl FnOnce() -> T) -> T {
    let begun = Instant::now();
    let result = work();
    micros.push(1e6 * begun.elapsed().as_secs_f64());
    result
}

/// Uniform in the box, the rotation uniform as well.
fn random_pose(corners: &[Point; 8], rng: &mut ChaCha8Rng) -> Pose {
    // The box's edges lead from its first corner to the corners 1, 2 and 4.
    let place = [1, 2, 4].iter().fold(corners[0], |at, corner| at + (corners[*corner] - corners[0]) * rng.random_range(0.0..1.0));
    loop {
        let q = Vector4::from_fn(|_, _| rng.random_range(-1.0..1.0));
        if (0.01..=1.0).contains(&q.norm()) {
            return Pose::from_parts(place.into(), Unit::new_normalize(Quaternion::from(q)));
        }
    }
}
