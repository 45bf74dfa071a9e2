//! `sfg`: grasps things as they are meant to be held, from a sentence.
#![expect(clippy::print_stderr, reason = "a command speaks to its user")]

mod assets;
mod check;
mod exit;
mod explain;
mod files;
mod gate;
mod log;
mod pictures;
mod plan;
mod plugins;
mod preview;
mod reach;
mod recorder;
mod replay;
mod robot;
mod run;
mod safety;
mod say;
mod scene;
mod sensed;
mod spheres;
mod statistics;
mod stopped;
mod sweep;
mod test;
mod tree;
mod view;
mod watch;

use crate::assets::Assets;
use crate::check::Checked;
use crate::say::say;
use anyhow::{Context as _, Result};
use clap::{Parser, Subcommand};
use sfg_scenario::Severity;
use sfg_types::{Instruction, RunReport, StageRecord};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Finds, grasps and uses things with a humanoid's hand, from a typed sentence.
///
/// Without a command it runs the demo: pours from a bottle into a bowl in the built-in simulator.
#[derive(Parser)]
#[command(name = "sfg", version, after_help = exit::HELP)]
struct Cli {
    /// Folder of robots, objects and scenarios.
    #[arg(long, global = true, value_name = "FOLDER")]
    assets: Option<PathBuf>,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Runs a scenario and judges it.
    Run {
        /// Scenario file, or with --scene a tree in XML of BehaviorTree.CPP 4.
        #[arg(required_unless_present = "resume")]
        scenario: Option<PathBuf>,
        #[command(flatten)]
        scene: SceneOption,
        #[command(flatten)]
        options: RunOptions,
        /// Folder of a run that was stopped by Ctrl-C or --stop-after: goes on from there. The simulator is first brought to
        /// where it was.
        #[arg(long, value_name = "RUN", conflicts_with_all = ["instruction", "seed", "preview"])]
        resume: Option<PathBuf>,
        /// Lists what each skill of the tree occupies and how long it takes; nothing moves.
        #[arg(long)]
        preview: bool,
    },
    /// Runs a sentence in a scene: the scene's scenario with another instruction.
    Say {
        /// What to do.
        sentence: String,
        /// Scenario whose scene, robot and tree are used.
        #[arg(long, value_name = "FILE")]
        scene: Option<PathBuf>,
        #[command(flatten)]
        options: RunOptions,
    },
    /// Finds every mistake of a scenario without running it.
    Check {
        /// Scenario file, or with --scene a tree in XML of BehaviorTree.CPP 4.
        scenario: PathBuf,
        #[command(flatten)]
        scene: SceneOption,
        #[command(flatten)]
        set: SetOptions,
    },
    /// Runs the cases of test files: trees of scenarios with preset results of their leaves, without a robot.
    Test {
        /// Test files.
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
    /// Trees as files of BehaviorTree.CPP: export, import, model.
    #[command(subcommand)]
    Tree(tree::TreeCommand),
    /// Shows a past run and runs its tree again with the recorded results of its leaves.
    Replay(replay::ReplayOptions),
    /// Recordings: info, recover, cut, diff, export.
    #[command(subcommand)]
    Log(log::LogCommand),
    /// Shows a run, or two side by side, on a page in the browser.
    View(view::ViewOptions),
    /// Says what a failure reason means and what to do.
    Explain {
        /// The reason, for example no_path.
        reason: String,
    },
    /// Motion planning by itself: bench.
    #[command(subcommand)]
    Plan(plan::PlanCommand),
    /// The safety filter, measured.
    #[command(subcommand)]
    Safety(safety::SafetyCommand),
    /// Robots by themselves: info, ik, reach.
    #[command(subcommand)]
    Robot(robot::RobotCommand),
    /// Inverse kinematics by itself: bench.
    #[command(subcommand)]
    Ik(robot::IkCommand),
    /// Runs a scenario over many seeds and prints success rates with their intervals.
    Sweep(sweep::SweepOptions),
    /// One step of a sweep, for schedulers: plan, run-shard, merge.
    #[command(subcommand)]
    Shard(sweep::ShardCommand),
    /// Prints the JSON Schema of scenario files.
    Schema {
        /// That of test files instead.
        #[arg(long)]
        tests: bool,
    },
}

/// Where a tree in XML runs.
#[derive(clap::Args, Clone, Default)]
struct SceneOption {
    /// Scenario whose robot, scene, plugins, success and limits a tree in XML is run with.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
}

#[derive(clap::Args, Clone, Default)]
struct RunOptions {
    /// What to do instead of the scenario's own instruction.
    #[arg(long, value_name = "SENTENCE")]
    instruction: Option<String>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for report, recording and pictures; a new one under runs/ when left out.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Goes on with the changed tree when the scenario's file changes while it runs.
    #[arg(long)]
    watch: bool,
    /// Stops, as Ctrl-C does, when this stage has ended: --stop-after lift.
    #[arg(long, value_name = "STAGE")]
    stop_after: Option<String>,
    /// Lets Groot2 look on at this port of this machine; it can change nothing.
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "1667")]
    groot2: Option<u16>,
    /// Serves the run live to Foxglove at this port of this machine; it can change nothing.
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "8765")]
    foxglove: Option<u16>,
    /// Leaves the report and the pictures, but no run.mcap.
    #[arg(long, conflicts_with = "foxglove")]
    no_recording: bool,
    #[command(flatten)]
    live: view::LiveOptions,
    #[command(flatten)]
    set: SetOptions,
}

/// Values of a scenario's parameters.
#[derive(clap::Args, Clone, Default)]
struct SetOptions {
    /// Value of a parameter of the scenario; may be given several times.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
}

static INTERRUPTED: AtomicBool = AtomicBool::new(false);
/// Signals that follow the first one sooner belong to it: `timeout -s INT` sends to the process and then to its group.
const SAME_INTERRUPT: Duration = Duration::from_secs(1);

/// The first Ctrl-C halts the robot, a later one ends the process at once.
fn on_interrupt() {
    static FIRST: OnceLock<Instant> = OnceLock::new();
    INTERRUPTED.store(true, Ordering::Relaxed);
    if FIRST.get_or_init(Instant::now).elapsed() > SAME_INTERRUPT {
        std::process::exit(i32::from(exit::INTERRUPTED));
    }
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    if let Err(error) = ctrlc::set_handler(on_interrupt) {
        eprintln!("warning: Ctrl-C will not halt the robot first: {error}");
    }
    match execute(cli) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {}", say::chain(&error));
            exit::code_of_error(&error)
        }
    }
}

fn execute(cli: Cli) -> Result<ExitCode> {
    let assets = cli.assets.as_deref();
    match cli.command {
        None => {
            let assets = Assets::open(assets)?;
            let scenario = assets.folder.join("01_pour.yaml");
            run_one(&assets, &scenario, None, &RunOptions { seed: 1, ..RunOptions::default() })
        }
        Some(Command::Run { scenario, scene, options, resume, preview }) => {
            let (assets, scene) = (Assets::open(assets)?, scene.scene.as_deref());
            match (scenario, resume) {
                (scenario, Some(run)) => resume_one(&assets, &run, scenario, scene, &options),
                (Some(scenario), None) if preview => {
                    preview::show(&Checked::load_in(&assets, &scenario, scene, &options.set.set)?)
                }
                (scenario, None) => run_one(&assets, &scenario.unwrap_or_default(), scene, &options),
            }
        }
        Some(Command::Test { files }) => test::test(&Assets::open(assets)?, &files),
        Some(Command::Tree(command)) => tree::execute(assets, &command),
        Some(Command::Log(command)) => log::execute(&command),
        Some(Command::View(options)) => view::view(&options, &INTERRUPTED),
        Some(Command::Replay(options)) => replay::show(&Assets::open(assets)?, &options),
        Some(Command::Say { sentence, scene, options }) => {
            let assets = Assets::open(assets)?;
            let scenario = scene.unwrap_or_else(|| assets.folder.join("01_pour.yaml"));
            run_one(&assets, &scenario, None, &RunOptions { instruction: Some(sentence), ..options })
        }
        Some(Command::Check { scenario, scene, set }) => {
            let checked = Checked::load_in(&Assets::open(assets)?, &scenario, scene.scene.as_deref(), &set.set)?;
            let warnings = &checked.scenario.warnings;
            let n_warnings = warnings.count(Severity::Warning);
            if n_warnings > 0 {
                say!("{warnings}");
            }
            let warned = if n_warnings > 0 { format!(", {}", check::numbered(n_warnings, "warning")) } else { String::new() };
            say!("{}: no mistakes{warned}, {} nodes", scenario.display(), checked.n_nodes()?);
            Ok(ExitCode::SUCCESS)
        }
        Some(Command::Explain { reason }) => {
            writeln!(std::io::stdout(), "{}", explain::entry(&reason)?).context("cannot write the explanation")?;
            Ok(ExitCode::SUCCESS)
        }
        Some(Command::Plan(command)) => plan::run(&command),
        Some(Command::Safety(command)) => safety::run(&Assets::open(assets)?, &command),
        Some(Command::Robot(command)) => robot::robot(&Assets::open(assets)?, &command),
        Some(Command::Ik(command)) => robot::bench(&Assets::open(assets)?, &command),
        Some(Command::Sweep(options)) => sweep::sweep(&Assets::open(assets)?, &options),
        Some(Command::Shard(command)) => sweep::shard(&Assets::open(assets)?, &command),
        Some(Command::Schema { tests }) => {
            let assets = Assets::open(assets)?;
            let text = if tests { check::test_schema_text(&assets)? } else { check::schema_text(&assets)? };
            writeln!(std::io::stdout(), "{text}").context("cannot write the schema")?;
            Ok(ExitCode::SUCCESS)
        }
    }
}

/// Goes on with a run that was stopped.
fn resume_one(
    assets: &Assets,
    run: &Path,
    scenario: Option<PathBuf>,
    scene: Option<&Path>,
    options: &RunOptions,
) -> Result<ExitCode> {
    let from = stopped::read(run)?;
    let scenario = scenario.unwrap_or_else(|| PathBuf::from(&from.scenario));
    let checked = Checked::load_in(assets, &scenario, scene, &options.set.set)?;
    if sfg_skills::context::hash_bytes(checked.scenario.full_text().as_bytes()) != from.scenario_sha256 {
        let message =
            format!("{} is not the scenario of {} any more; run it from the beginning", scenario.display(), run.display());
        return Err(check::BadInput(message).into());
    }
    let options = RunOptions { instruction: Some(from.instruction.clone()), seed: from.seed, ..options.clone() };
    run_checked(assets, &scenario, scene, &checked, &options, Some(&from.stopped))
}

fn run_one(assets: &Assets, scenario: &Path, scene: Option<&Path>, options: &RunOptions) -> Result<ExitCode> {
    let checked = Checked::load_in(assets, scenario, scene, &options.set.set)?;
    run_checked(assets, scenario, scene, &checked, options, None)
}

fn run_checked(
    assets: &Assets,
    scenario: &Path,
    scene: Option<&Path>,
    checked: &Checked,
    options: &RunOptions,
    resumed: Option<&stopped::Stopped>,
) -> Result<ExitCode> {
    let instruction = match (&options.instruction, &checked.scenario.instruction) {
        (Some(text), _) => Instruction::new(text).map_err(|error| check::BadInput(error.to_string()))?,
        (None, Some(instruction)) => instruction.value.clone(),
        (None, None) => {
            let message = format!("{} has no instruction; give one with --instruction", scenario.display());
            return Err(check::BadInput(message).into());
        }
    };
    if let Some(stage) = &options.stop_after {
        let tree = checked.scenario.build_tree(&checked.registry)?;
        let kinds: Vec<String> = tree.preview().steps.into_iter().map(|step| step.kind).collect();
        if !kinds.contains(stage) {
            let near = sfg_tree::nearest(stage, kinds.iter().map(String::as_str));
            let help =
                near.map_or_else(|| format!("its skills are {}", kinds.join(", ")), |near| format!("did you mean {near:?}?"));
            return Err(check::BadInput(format!("--stop-after: the tree has no skill {stage:?}; {help}")).into());
        }
    }
    let folder = match &options.out {
        Some(folder) => folder.clone(),
        None => default_folder(scenario, options.seed)?,
    };
    say!("“{}” · {} · seed {}", instruction.as_str(), scenario.display(), options.seed);
    let watched = options.watch.then(|| watch::Watch::new(assets, scenario, scene, &options.set.set));
    let page = view::LivePage::open(&options.live, &scenario.file_stem().unwrap_or_default().to_string_lossy())?;
    let report = run::run(&run::RunRequest {
        scenario: &checked.scenario,
        registry: &checked.registry,
        assets,
        model: &checked.model,
        reach: checked.reach.clone(),
        instruction,
        seed: options.seed,
        folder: Some(folder.clone()),
        interrupted: &INTERRUPTED,
        simulator: run::Simulator::default(),
        resumed,
        stop_after: options.stop_after.as_deref(),
        groot2: options.groot2,
        foxglove: options.foxglove,
        is_recorded: !options.no_recording,
        tap: page.as_ref().map(view::LivePage::tap),
        control: page.as_ref().and_then(view::LivePage::control),
        watch: &|| watched.as_ref().and_then(watch::Watch::changed),
        on_stage: &print_stage,
    })?;
    print_verdict(&report);
    if folder.join(stopped::FILE).is_file() {
        say!("go on with: sfg run --resume {}", folder.display());
    }
    say!("report: {}", folder.join("report.html").display());
    if let Some(page) = page {
        page.finish(&INTERRUPTED);
    }
    Ok(exit::code(report.outcome))
}

fn default_folder(scenario: &Path, seed: u64) -> Result<PathBuf> {
    let now_secs = SystemTime::now().duration_since(UNIX_EPOCH).context("the system clock is before 1970")?.as_secs();
    let stem = scenario.file_stem().unwrap_or_default().to_string_lossy();
    Ok(PathBuf::from("runs").join(format!("{now_secs}-{stem}-{seed}")))
}

fn print_stage(stage: &StageRecord, wall_secs: f64) {
    let mark = stage.failure.map_or_else(|| "ok".to_owned(), |reason| reason.name().to_owned());
    say!("{:7.2} s  {:22} {mark:5} {}  [{:.0} ms]", stage.stamp_secs, stage.stage, stage.summary, 1000.0 * wall_secs);
}

fn print_verdict(report: &RunReport) {
    if let Some(failure) = &report.failure {
        say!("failed: {} at {}: {}", failure.reason, failure.node, failure.explanation);
        say!("see {}", explain::link(&failure.reason));
    }
    for predicate in &report.predicates {
        let word = if predicate.passed { "holds" } else { "FAILS" };
        say!("  {word}  {} ({}): {}", predicate.predicate, predicate.evaluator, predicate.measured);
    }
    say!(
        "verdict: {:?} after {:.1} s of robot time, {:.1} s of yours",
        report.outcome,
        report.duration_secs,
        report.timings["total_secs"].as_f64().unwrap_or(0.0)
    );
}
