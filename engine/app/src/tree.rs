//! `sfg tree`: trees as BehaviorTree.CPP and its editors have them.

use crate::SetOptions;
use crate::assets::Assets;
use crate::check::{Checked, node_registry, refused};
use crate::files::write_out;
use crate::say::say;
use anyhow::Result;
use clap::Subcommand;
use sfg_scenario::{Severity, XmlTree};
use sfg_tree::xml;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What to do with a tree.
#[derive(Subcommand)]
pub(crate) enum TreeCommand {
    /// Writes a scenario's tree as XML of BehaviorTree.CPP 4.
    Export {
        /// Scenario file.
        scenario: PathBuf,
        #[command(flatten)]
        set: SetOptions,
        #[command(flatten)]
        out: OutOption,
    },
    /// Writes a tree in XML of BehaviorTree.CPP 4 as `tree` and `subtrees` of a scenario.
    Import {
        /// XML file.
        xml: PathBuf,
        #[command(flatten)]
        out: OutOption,
    },
    /// Writes the palette of all skills as XML, for an editor of trees.
    Model {
        #[command(flatten)]
        out: OutOption,
    },
}

/// Where the text goes.
#[derive(clap::Args)]
pub(crate) struct OutOption {
    /// File to write; standard output when left out.
    #[arg(short, long = "output", value_name = "FILE")]
    output: Option<PathBuf>,
}

impl OutOption {
    fn write(&self, text: &str) -> Result<ExitCode> {
        write_out(self.output.as_deref(), text)?;
        if let Some(path) = &self.output {
            say!("wrote {}", path.display());
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Carries out a command.
pub(crate) fn execute(assets: Option<&Path>, command: &TreeCommand) -> Result<ExitCode> {
    let registry = node_registry();
    match command {
        TreeCommand::Export { scenario, set, out } => {
            let checked = Checked::load(&Assets::open(assets)?, scenario, &set.set)?;
            out.write(&checked.scenario.to_xml(registry.models()).map_err(|errors| refused(&errors))?)
        }
        TreeCommand::Import { xml, out } => {
            let tree = XmlTree::load(xml).map_err(|errors| refused(&errors))?;
            let warnings = tree.warnings();
            if warnings.count(Severity::Warning) > 0 {
                // Standard output may be the file.
                eprintln!("{warnings}");
            }
            out.write(&tree.to_yaml(registry.models()).map_err(|errors| refused(&errors))?)
        }
        TreeCommand::Model { out } => out.write(&xml::export_models(registry.models())),
    }
}
