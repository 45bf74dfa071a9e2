//! `cargo run --release -p sfg-fuzz -- TARGET [N] [SEED]`: N mutants of the corpus; the worst time is printed. A crash leaves
//! its input in the current folder as `fuzz-TARGET-crash.txt`, to be put into the corpus.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a program for developers")]

use indicatif::ProgressBar;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use sfg_fuzz::{Target, corpus, mutant};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// An input that takes longer is a find.
const MAX_TIME: Duration = Duration::from_secs(1);

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let name = args.next().unwrap_or_default();
    let Some(target) = Target::ALL.into_iter().find(|target| target.name() == name) else {
        eprintln!("error: expected yaml, xml or script, found {name:?}; then a number of inputs and a seed");
        return ExitCode::from(2);
    };
    let mut number = |default: u64| args.next().map_or(Some(default), |text| text.parse().ok());
    let (Some(n_inputs), Some(seed)) = (number(1_000_000), number(1)) else {
        eprintln!("error: the number of inputs and the seed are whole numbers");
        return ExitCode::from(2);
    };
    let inputs = match corpus(target) {
        Ok(inputs) => inputs,
        Err(error) => {
            eprintln!("error: the corpus cannot be read: {error}");
            return ExitCode::from(5);
        }
    };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let bar = ProgressBar::new(n_inputs);
    let mut longest = (Duration::ZERO, String::new());
    for _ in 0..n_inputs {
        let input = mutant(target, &inputs, &mut random);
        let begun = Instant::now();
        if std::panic::catch_unwind(|| target.try_out(&input)).is_err() {
            return keep(target, &input, "crashes");
        }
        let taken = begun.elapsed();
        if taken > MAX_TIME {
            return keep(target, &input, "takes more than a second");
        }
        if taken > longest.0 {
            longest = (taken, input);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    println!(
        "{name}: {n_inputs} inputs from seed {seed}, no crash; the longest took {:.1} ms ({} bytes)",
        longest.0.as_secs_f64() * 1e3,
        longest.1.len()
    );
    ExitCode::SUCCESS
}

fn keep(target: Target, input: &str, what: &str) -> ExitCode {
    let path = format!("fuzz-{}-crash.txt", target.name());
    match std::fs::write(&path, input) {
        Ok(()) => eprintln!("error: an input {what}; it is in {path}"),
        Err(error) => eprintln!("error: an input {what}, and {path} cannot be written: {error}\n{input}"),
    }
    ExitCode::from(1)
}
