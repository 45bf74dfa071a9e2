//! `sfg test`: the cases of test files, each a line.

use crate::assets::Assets;
use crate::check::{self, BadInput};
use crate::exit;
use crate::say::say;
use anyhow::Result;
use sfg_scenario::{ScenarioTests, TestCase};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Runs every case of every file. Nothing runs when one of the files has mistakes.
pub(crate) fn test(assets: &Assets, files: &[PathBuf]) -> Result<ExitCode> {
    let (mut loaded, mut refused) = (Vec::new(), Vec::new());
    for file in files {
        match check::load_tests(assets, file) {
            Ok(tests) => loaded.push((file, tests)),
            Err(BadInput(message)) => refused.push(message),
        }
    }
    if !refused.is_empty() {
        return Err(BadInput(refused.join("\n")).into());
    }
    let (mut n_cases, mut n_failed) = (0, 0);
    for (file, ScenarioTests { cases, .. }) in loaded {
        say!("{}", file.display());
        for case in cases {
            n_cases += 1;
            n_failed += usize::from(!holds(file, case));
        }
    }
    let cases = check::numbered(n_cases, "case");
    if n_failed == 0 {
        say!("{cases}, all ok");
        return Ok(ExitCode::SUCCESS);
    }
    say!("{cases}: {} ok, {n_failed} FAILED", n_cases - n_failed);
    Ok(exit::DIFFERENT.into())
}

/// Runs a case and says how it went.
fn holds(file: &Path, case: TestCase) -> bool {
    let (name, line) = (case.name.value.clone(), case.name.place.line);
    let result = case.run();
    if result.differences.is_empty() {
        say!("ok      {name}");
        return true;
    }
    say!("FAILED  {name} ({}:{line})", file.display());
    for difference in &result.differences {
        say!("        {difference}");
    }
    if result.differences.iter().any(|difference| difference.is_of_trace()) {
        say!("        the whole trace: [{}]", result.trace.join(", "));
    }
    false
}
