//! `sfg replay`: what happened in a run, and whether the tree would decide the same again.

use crate::assets::Assets;
use crate::check::{BadInput, Checked};
use crate::exit;
use crate::say::say;
use anyhow::Result;
use sfg_record::{read_run, recording_path};
use sfg_tree::{NamedChange, NamedRecord, Status, replay};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What to replay.
#[derive(clap::Args)]
pub(crate) struct ReplayOptions {
    /// Folder of a run, or its run.mcap.
    run: PathBuf,
    /// Scenario whose tree decides again; the run's own when left out.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Values of the scenario's parameters, as in the run.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Shows every status change instead of those of leaves that ended.
    #[arg(long)]
    all: bool,
}

/// Shows a past run and runs its tree again with the recorded results of its leaves.
pub(crate) fn show(assets: &Assets, options: &ReplayOptions) -> Result<ExitCode> {
    let run = read_run(&recording_path(&options.run)).map_err(|error| BadInput(error.to_string()))?;
    let value = |key: &str| run.metadata.get(key).map_or("?", String::as_str);
    say!("“{}” · {} · seed {}", value("instruction"), value("scenario"), value("seed"));
    print_changes(&run.journal, options.all);
    if !run.is_whole {
        let end_secs = run.journal.last().map_or(0.0, |record| record.now_secs);
        say!("the recording is cut off or damaged after {end_secs:.2} s: only what is there is replayed");
    }
    if run.metadata.contains_key("resumed") {
        let message =
            "the run was resumed, so that its tree did not begin anew: it cannot be replayed; replay the run it came from";
        return Err(BadInput(message.to_owned()).into());
    }
    if run.metadata.contains_key("cut_from_secs") {
        let message = "the recording is a part of another, so that its tree does not begin anew: replay the whole one";
        return Err(BadInput(message.to_owned()).into());
    }
    let scenario = match &options.scenario {
        Some(scenario) => scenario.clone(),
        None => find_scenario(assets, Path::new(value("scenario"))).ok_or_else(|| {
            BadInput(format!("the scenario {} of the run is not here any more; give one with --scenario", value("scenario")))
        })?,
    };
    let checked = Checked::load(assets, &scenario, &options.set)?;
    let is_same = sfg_skills::context::hash_bytes(checked.scenario.full_text().as_bytes()) == value("scenario_sha256");
    if !is_same {
        say!("{} is not the file that was run: this is how its tree would have decided", scenario.display());
    }
    let replayed = replay(&checked.registry, &checked.scenario.tree, &run.journal)
        .map_err(|errors| BadInput(format!("{}: {}", scenario.display(), errors[0])))?;
    match replayed.divergence {
        None => {
            say!("{} ticks replayed with the recorded results of the leaves: no divergence", replayed.n_ticks);
            Ok(ExitCode::SUCCESS)
        }
        Some(at) => {
            say!("first divergence in tick {} at {:.3} s", at.tick_idx, at.now_secs);
            say!("  recorded  {}", at.recorded);
            say!("  replayed  {}", at.replayed);
            Ok(exit::DIFFERENT.into())
        }
    }
}

/// The scenario where it was, or one of that name among the assets.
fn find_scenario(assets: &Assets, path: &Path) -> Option<PathBuf> {
    let shipped = path.file_name().map(|name| assets.folder.join(name));
    [Some(path.to_owned()), shipped].into_iter().flatten().find(|path| path.is_file())
}

fn print_changes(journal: &[NamedRecord], all: bool) {
    let mut failure = None;
    for record in journal {
        match &record.change {
            NamedChange::Failed(found) => failure = Some((&record.path, found)),
            NamedChange::Status { from, to } => {
                let is_end = matches!(to, Status::Success | Status::Failure) || (*from == Status::Running && *to == Status::Idle);
                if !all && !is_end {
                    continue;
                }
                let why = failure.take_if(|(path, _)| *path == &record.path && *to == Status::Failure);
                let why = why.map_or(String::new(), |(_, failure)| format!("  {failure}"));
                let to = if *from == Status::Running && *to == Status::Idle { "halted" } else { to.name() };
                say!("{:9.3} s  {to:8} {}{why}", record.now_secs, record.path);
            }
            _ => {}
        }
    }
}
