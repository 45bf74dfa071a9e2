//! `sfg run --preview`: what a scenario's tree would do and occupy. Nothing moves.

use crate::check::Checked;
use crate::exit;
use crate::say::say;
use anyhow::Result;
use sfg_tree::{Footprint, NodeClass};
use std::process::ExitCode;

/// Prints each skill of the tree with its footprint, then the clashes of parallel branches; these end in a failure.
pub(crate) fn show(checked: &Checked) -> Result<ExitCode> {
    let scenario = &checked.scenario;
    let preview = scenario.build_tree(&checked.registry)?.preview();
    let side = format!("{:?}", scenario.arm).to_lowercase();
    say!("the tree of {}, {side} arm; nothing moves", scenario.path().display());
    match &scenario.limits.workspace {
        Some(space) => say!(
            "the palm stays within x {}..{} m, y {}..{} m, z {}..{} m",
            space.x_m.min,
            space.x_m.max,
            space.y_m.min,
            space.y_m.max,
            space.z_m.min,
            space.z_m.max
        ),
        None => say!("the palm may go everywhere (no limits.workspace)"),
    }
    say!("{:22} {:26} {:>9}  path", "skill", "occupies", "usually");
    let mut sum_secs = 0.0;
    for step in preview.steps.iter().filter(|step| step.class != NodeClass::Condition) {
        let occupies = match &step.footprint {
            Footprint::Parts(parts) => parts.iter().map(|part| name_of(part, &side)).collect::<Vec<_>>().join(", "),
            Footprint::Undeclared if step.class == NodeClass::Step => "-".to_owned(),
            Footprint::Undeclared => "not said".to_owned(),
        };
        let usually = step.expected_secs.map_or_else(|| "at once".to_owned(), |secs| format!("{secs:.0} s"));
        sum_secs += step.expected_secs.unwrap_or(0.0);
        say!("{:22} {occupies:26} {usually:>9}  {}", step.kind, step.path);
    }
    say!("each once: about {sum_secs:.0} s of robot time; the limit is {:.0} s", scenario.limits.timeout_secs);
    if preview.conflicts.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    for conflict in &preview.conflicts {
        say!(
            "conflict in {}: {} and {} both occupy the {}; the second would wait for the first",
            conflict.parallel,
            conflict.first,
            conflict.second,
            name_of(&conflict.part, &side)
        );
    }
    Ok(exit::BAD_INPUT.into())
}

/// Arms and hands have a side.
fn name_of(part: &str, side: &str) -> String {
    if part == "arm" || part == "hand" { format!("{side} {part}") } else { part.to_owned() }
}
