//! Many seeds of one scenario, as `plan`, `run-shard` and `merge`: the same bytes whatever runs the shards, and resumable.
//!
//! `sweep` is the three in one on this machine. A crash, a timeout or a refusal counts as a failure: the denominator is what
//! was planned.

use crate::INTERRUPTED;
use crate::assets::Assets;
use crate::check::{BadInput, Checked};
use crate::exit::{self, Interrupted};
use crate::files::write_whole;
use crate::run::{RunRequest, run};
use crate::say::{chain, say};
use crate::statistics::wilson_interval;
use anyhow::{Context as _, Result};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sfg_types::{Instruction, Outcome, PredicateResult};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

/// Which seeds of which scenario.
#[derive(clap::Args, Clone)]
pub(crate) struct SweepOptions {
    /// Scenario file.
    scenario: PathBuf,
    /// First and last seed, for example 1..20.
    #[arg(long, value_name = "A..B", conflicts_with = "seeds_from_commit")]
    seeds: Option<String>,
    /// So many seeds drawn from the hash of the checked-out commit, so that nobody chose them.
    #[arg(long, value_name = "N")]
    seeds_from_commit: Option<usize>,
    /// Where the merged result goes.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Folder of the parts; an interrupted sweep goes on where it stopped.
    #[arg(long, value_name = "FOLDER", default_value = "runs/sweep")]
    work: PathBuf,
    #[command(flatten)]
    set: crate::SetOptions,
    /// Worlds at a time.
    #[arg(long, default_value_t = 2)]
    jobs: usize,
}

/// One step of a sweep.
#[derive(clap::Subcommand)]
pub(crate) enum ShardCommand {
    /// Writes job.json: what the shards are.
    Plan {
        #[command(flatten)]
        options: SweepOptions,
        /// Seeds in each shard.
        #[arg(long, default_value_t = 10)]
        per_shard: usize,
    },
    /// Runs one shard; does nothing when its part is there already.
    RunShard {
        /// job.json of the plan.
        #[arg(long)]
        job: PathBuf,
        /// Which one, from 0.
        #[arg(long)]
        shard: usize,
        /// Folder of the parts.
        #[arg(long)]
        out: PathBuf,
    },
    /// Puts the parts together; fails when one is missing.
    Merge {
        /// job.json of the plan.
        #[arg(long)]
        job: PathBuf,
        /// Folder of the parts.
        #[arg(long)]
        out: PathBuf,
        /// Where the result goes.
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
    },
}

const JOB_SCHEMA_VERSION: u32 = 1;
/// A larger sweep is a slip of the finger.
const MAX_SEEDS: u64 = 1_000_000;

/// What is to be run; its id is the hash of the rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Job {
    schema_version: u32,
    kind: String,
    scenario: PathBuf,
    /// Parameters of the scenario, as `name=value`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    set: Vec<String>,
    scenario_sha256: String,
    engine_version: String,
    engine_sha256: String,
    commit: Option<String>,
    seeds: Vec<u64>,
    seeds_per_shard: usize,
    id: String,
}

/// One trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Unit {
    seed: u64,
    outcome: Outcome,
    /// Stage and reason of a failure.
    failure: Option<(String, String)>,
    predicates: Vec<PredicateResult>,
    grasp: serde_json::Value,
    decision_secs: f64,
    robot_secs: f64,
    wall_secs: f64,
}

#[derive(Serialize, Deserialize)]
struct Part {
    job_id: String,
    units: Vec<Unit>,
}

impl Job {
    fn plan(options: &SweepOptions, assets: &Assets, seeds_per_shard: usize) -> Result<Self> {
        let text = Checked::load(assets, &options.scenario, &options.set.set)?.scenario.full_text();
        let commit = git_commit();
        let seeds = match (&options.seeds, options.seeds_from_commit) {
            (Some(range), None) => parse_range(range)?,
            (None, Some(n)) if n as u64 > MAX_SEEDS => {
                return Err(BadInput(format!("--seeds-from-commit {n}: at most {MAX_SEEDS}")).into());
            }
            (None, Some(n)) => {
                let commit = commit.clone().context("--seeds-from-commit needs a git checkout and git; give --seeds A..B")?;
                seeds_from(&commit, n)
            }
            _ => return Err(BadInput("give --seeds A..B or --seeds-from-commit N".to_owned()).into()),
        };
        let program = std::env::current_exe().and_then(std::fs::read).context("cannot read the running program")?;
        let mut job = Self {
            schema_version: JOB_SCHEMA_VERSION,
            kind: "sweep".to_owned(),
            scenario: options.scenario.clone(),
            set: options.set.set.clone(),
            scenario_sha256: sfg_skills::context::hash_bytes(text.as_bytes()),
            engine_version: env!("CARGO_PKG_VERSION").to_owned(),
            engine_sha256: sfg_skills::context::hash_bytes(&program),
            commit,
            seeds,
            seeds_per_shard: seeds_per_shard.max(1),
            id: String::new(),
        };
        job.id = sfg_skills::context::hash_of(&job);
        Ok(job)
    }

    fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        let job: Self = serde_json::from_str(&text).map_err(|error| BadInput(format!("{}: {error}", path.display())))?;
        let unnamed = Self { id: String::new(), ..job.clone() };
        if job.id != sfg_skills::context::hash_of(&unnamed) {
            return Err(BadInput(format!("{} was changed by hand; plan again", path.display())).into());
        }
        Ok(job)
    }

    fn n_shards(&self) -> usize {
        self.seeds.len().div_ceil(self.seeds_per_shard)
    }

    fn seeds_of(&self, shard: usize) -> &[u64] {
        let begin = (shard * self.seeds_per_shard).min(self.seeds.len());
        &self.seeds[begin..(begin + self.seeds_per_shard).min(self.seeds.len())]
    }
}

fn parse_range(text: &str) -> Result<Vec<u64>> {
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let parsed = text.split_once("..").and_then(|(a, b)| Some((number(a)?, number(b)?)));
    match parsed {
        Some((first, last)) if first <= last && last - first < MAX_SEEDS => Ok((first..=last).collect()),
        _ => Err(BadInput(format!(
            "--seeds {text:?} is no range; write for example 1..20, both ends included, at most {MAX_SEEDS} seeds"
        ))
        .into()),
    }
}

/// Seeds that follow from a commit: the first 8 bytes of SHA-256 over the hash and the number, kept below 2^53 for JSON readers.
fn seeds_from(commit: &str, n: usize) -> Vec<u64> {
    (0..n)
        .map(|number| {
            let digest = Sha256::digest(format!("{commit}/{number}"));
            let mut bytes = [0; 8];
            bytes.copy_from_slice(&digest[..8]);
            u64::from_le_bytes(bytes) >> 11
        })
        .collect()
}

fn git_commit() -> Option<String> {
    let output = std::process::Command::new("git").args(["rev-parse", "HEAD"]).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Runs one seed; whatever goes wrong is a failed trial.
fn run_unit(checked: &Checked, assets: &Assets, instruction: &Instruction, seed: u64) -> Unit {
    let begun = std::time::Instant::now();
    let request = RunRequest {
        scenario: &checked.scenario,
        registry: &checked.registry,
        assets,
        model: &checked.model,
        reach: checked.reach.clone(),
        instruction: instruction.clone(),
        seed,
        folder: None,
        interrupted: &INTERRUPTED,
        simulator: crate::run::Simulator::default(),
        resumed: None,
        stop_after: None,
        groot2: None,
        foxglove: None,
        is_recorded: true,
        tap: None,
        control: None,
        watch: &|| None,
        on_stage: &|_, _| {},
    };
    let failed = |stage: &str, reason: String| Unit {
        seed,
        outcome: Outcome::TreeFailure,
        failure: Some((stage.to_owned(), reason)),
        predicates: Vec::new(),
        grasp: serde_json::Value::Null,
        decision_secs: 0.0,
        robot_secs: 0.0,
        wall_secs: begun.elapsed().as_secs_f64(),
    };
    match catch_unwind(AssertUnwindSafe(|| run(&request))) {
        Ok(Ok(report)) => Unit {
            seed,
            outcome: report.outcome,
            failure: failure_of(&report),
            predicates: report.predicates,
            grasp: report.judge["grasp"].clone(),
            decision_secs: report.timings["decision_secs"].as_f64().unwrap_or(0.0),
            robot_secs: report.duration_secs,
            wall_secs: begun.elapsed().as_secs_f64(),
        },
        Ok(Err(error)) => failed("set-up", chain(&error)),
        Err(_) => failed("crash", "panicked".to_owned()),
    }
}

/// Stage and reason of a trial that is no success.
fn failure_of(report: &sfg_types::RunReport) -> Option<(String, String)> {
    match report.outcome {
        Outcome::Success => None,
        Outcome::JudgedFailure => {
            let failed = report.predicates.iter().find(|predicate| predicate.evaluator == "truth" && !predicate.passed);
            Some(("judge".to_owned(), failed.map_or_else(String::new, |predicate| predicate.predicate.clone())))
        }
        _ => {
            let failure = report.failure.as_ref();
            let stage = failure.and_then(|failure| failure.node.rsplit('/').next()).unwrap_or("run").to_owned();
            Some((stage, failure.map_or_else(|| format!("{:?}", report.outcome), |failure| failure.reason.clone())))
        }
    }
}

/// Runs a shard unless its part is there; the part is written whole or not at all.
fn run_shard(job: &Job, shard: usize, out: &Path, assets: &Assets, progress: &dyn Fn()) -> Result<Part> {
    if shard >= job.n_shards() {
        return Err(BadInput(format!("shard {shard} of a job with {} shards", job.n_shards())).into());
    }
    let path = out.join(format!("part-{shard:05}.json"));
    if path.exists() {
        let text = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let part: Part = serde_json::from_str(&text).with_context(|| format!("{} is no part of a sweep", path.display()))?;
        if part.job_id != job.id {
            let message = format!("{} belongs to another job; choose another folder or remove it", path.display());
            return Err(BadInput(message).into());
        }
        job.seeds_of(shard).iter().for_each(|_| progress());
        return Ok(part);
    }
    let checked = Checked::load(assets, &job.scenario, &job.set)?;
    if sfg_skills::context::hash_bytes(checked.scenario.full_text().as_bytes()) != job.scenario_sha256 {
        let message = format!("{} is not what the job was planned with; plan again", job.scenario.display());
        return Err(BadInput(message).into());
    }
    let instruction = match &checked.scenario.instruction {
        Some(instruction) => instruction.value.clone(),
        None => return Err(BadInput(format!("{} has no instruction", job.scenario.display())).into()),
    };
    let mut units = Vec::new();
    for &seed in job.seeds_of(shard) {
        units.push(run_unit(&checked, assets, &instruction, seed));
        if INTERRUPTED.load(Ordering::Relaxed) {
            return Err(Interrupted(format!("the parts in {} are kept, the same command goes on", out.display())).into());
        }
        progress();
    }
    let part = Part { job_id: job.id.clone(), units };
    write_whole(&path, &serde_json::to_vec_pretty(&part)?)?;
    Ok(part)
}

/// The merged result: what was run, how often it succeeded, and where it failed.
fn merged(job: &Job, parts: Vec<Part>) -> serde_json::Value {
    let mut units: Vec<Unit> = parts.into_iter().flat_map(|part| part.units).collect();
    units.sort_by_key(|unit| job.seeds.iter().position(|seed| *seed == unit.seed));
    let n_trials = job.seeds.len();
    let n_successes = units.iter().filter(|unit| unit.outcome == Outcome::Success).count();
    let (low, high) = wilson_interval(n_successes, n_trials);
    let mut failures: BTreeMap<String, usize> = BTreeMap::new();
    for (stage, reason) in units.iter().filter_map(|unit| unit.failure.as_ref()) {
        *failures.entry(format!("{stage}: {reason}")).or_default() += 1;
    }
    let agreements = units
        .iter()
        .filter(|unit| !unit.predicates.is_empty())
        .filter(|unit| {
            let all = |evaluator: &str| unit.predicates.iter().filter(|p| p.evaluator == evaluator).all(|p| p.passed);
            all("truth") == all("sensed")
        })
        .count();
    let n_judged = units.iter().filter(|unit| !unit.predicates.is_empty()).count();
    let grasp_share = |key: &str| units.iter().filter(|unit| unit.grasp[key] == true).count();
    let median = |values: Vec<f64>| -> f64 {
        let mut values = values;
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    serde_json::json!({
        "job": job,
        "n_trials": n_trials,
        "n_successes": n_successes,
        "success_rate": n_successes as f64 / n_trials.max(1) as f64,
        "wilson_95": [low, high],
        "failures": failures,
        "n_lifted": grasp_share("lifted"),
        "n_functional": grasp_share("functional_success"),
        "truth_and_sensed_agree": [agreements, n_judged],
        "median_decision_secs": median(units.iter().map(|unit| unit.decision_secs).collect()),
        "median_wall_secs": median(units.iter().map(|unit| unit.wall_secs).collect()),
        "units": units,
    })
}

fn print_merged(result: &serde_json::Value) {
    say!(
        "{} of {} judged successes ({:.1} %, 95 % interval {:.1}-{:.1} %)",
        result["n_successes"],
        result["n_trials"],
        100.0 * result["success_rate"].as_f64().unwrap_or(0.0),
        100.0 * result["wilson_95"][0].as_f64().unwrap_or(0.0),
        100.0 * result["wilson_95"][1].as_f64().unwrap_or(0.0),
    );
    say!("lifted {}, functional grasps {}", result["n_lifted"], result["n_functional"]);
    if let Some(failures) = result["failures"].as_object() {
        for (reason, n) in failures {
            say!("  {n:>4}  {reason}");
        }
    }
    say!(
        "truth and sensed predicates agree in {} of {}; decision {:.2} s, trial {:.1} s (medians)",
        result["truth_and_sensed_agree"][0],
        result["truth_and_sensed_agree"][1],
        result["median_decision_secs"].as_f64().unwrap_or(0.0),
        result["median_wall_secs"].as_f64().unwrap_or(0.0),
    );
}

/// Plans, runs what is missing and merges.
pub(crate) fn sweep(assets: &Assets, options: &SweepOptions) -> Result<ExitCode> {
    let job = Job::plan(options, assets, 1)?;
    let out = options.work.join(&job.id[..16]);
    write_whole(&out.join("job.json"), &serde_json::to_vec_pretty(&job)?)?;
    let bar = ProgressBar::new(job.seeds.len() as u64).with_style(
        ProgressStyle::with_template("{bar:30} {pos}/{len} trials, {elapsed} gone, {eta} left")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.jobs.max(1)).build().context("cannot start threads")?;
    let parts: Vec<Part> = pool.install(|| {
        (0..job.n_shards())
            .into_par_iter()
            .map(|shard| run_shard(&job, shard, &out, assets, &|| bar.inc(1)))
            .collect::<Result<_>>()
    })?;
    bar.finish_and_clear();
    finish(&job, parts, options.json.as_deref())
}

fn finish(job: &Job, parts: Vec<Part>, json: Option<&Path>) -> Result<ExitCode> {
    let result = merged(job, parts);
    if let Some(path) = json {
        let mut text = serde_json::to_vec_pretty(&result)?;
        text.push(b'\n');
        write_whole(path, &text)?;
    }
    print_merged(&result);
    Ok(ExitCode::from(exit::SUCCESS))
}

/// One step of a sweep.
pub(crate) fn shard(assets: &Assets, command: &ShardCommand) -> Result<ExitCode> {
    match command {
        ShardCommand::Plan { options, per_shard } => {
            let job = Job::plan(options, assets, *per_shard)?;
            let path = options.work.join("job.json");
            write_whole(&path, &serde_json::to_vec_pretty(&job)?)?;
            say!("{}: {} seeds in {} shards", path.display(), job.seeds.len(), job.n_shards());
            Ok(ExitCode::from(exit::SUCCESS))
        }
        ShardCommand::RunShard { job, shard, out } => {
            run_shard(&Job::read(job)?, *shard, out, assets, &|| {})?;
            Ok(ExitCode::from(exit::SUCCESS))
        }
        ShardCommand::Merge { job, out, json } => {
            let job = Job::read(job)?;
            let parts = (0..job.n_shards())
                .map(|shard| {
                    let path = out.join(format!("part-{shard:05}.json"));
                    let text = std::fs::read_to_string(&path)
                        .with_context(|| format!("{} is missing; run shard {shard}", path.display()))?;
                    let part: Part = serde_json::from_str(&text).with_context(|| format!("{} is broken", path.display()))?;
                    if part.job_id != job.id {
                        return Err(BadInput(format!("{} belongs to another job", path.display())).into());
                    }
                    Ok(part)
                })
                .collect::<Result<_>>()?;
            finish(&job, parts, json.as_deref())
        }
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[test]
    fn ranges_hold_both_ends_and_nonsense_is_refused() {
        assert_eq!(parse_range("3..5").unwrap(), [3, 4, 5]);
        for text in ["5..3", "1", "a..b", "", "0..18446744073709551615"] {
            assert!(parse_range(text).is_err(), "{text}");
        }
    }

    #[test]
    fn seeds_follow_from_the_commit_alone() {
        assert_eq!(seeds_from("abc", 5)[..3], seeds_from("abc", 3)[..]);
        assert_ne!(seeds_from("abc", 1), seeds_from("abd", 1));
        assert!(seeds_from("abc", 100).iter().all(|seed| *seed < 1 << 53));
    }
}
