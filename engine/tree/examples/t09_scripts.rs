//! Lesson 9, scripts: small calculations and conditions stand in the tree, beside the nodes they belong to.

use sfg_tree::nodes::{always_failure, always_success, fallback, node, precondition, script, script_condition, sequence};
use sfg_tree::{Literal, Ports, Registry, TreeSpec, When};
use std::error::Error;
use std::io::{self, Write};

#[derive(Ports)]
struct SayPorts {
    #[port(setting)]
    text: String,
}

pub(crate) fn run(out: &mut impl Write) -> Result<(), Box<dyn Error>> {
    let mut registry = Registry::<Vec<String>>::new();
    registry.step_with::<SayPorts>("say", |tick, ports| {
        tick.context.push(ports.text);
        Ok(())
    });
    let say = |text: &str| node("say").with("text", text);
    let root = sequence([
        script("tries := tries + 1; colour := tries % 2 == 1 ? 'red' : 'blue'; heavy := mass_kg > 0.5 && !empty"),
        precondition("colour == 'red'", say("it is red")).with("else", "skipped"),
        // Conditions before a node ...
        say("it is light").when(When::SkipIf, "heavy"),
        always_failure().when(When::SuccessIf, "tries < 10"),
        // ... and after it.
        always_success().when(When::OnSuccess, "n_done += 1").when(When::Post, "n_ended += 1"),
        fallback([script_condition("n_done >= 2"), say("again")]),
    ]);
    let spec =
        TreeSpec::new(root).entry("tries", 0).entry("mass_kg", 0.7).entry("empty", false).entry("n_done", 0).entry("n_ended", 0);
    let mut tree = registry.tree(spec)?;
    for tick in 1..=2 {
        let mut said = Vec::new();
        let status = tree.tick(f64::from(tick), &mut said);
        let value = |key: &str| tree.literal(key).unwrap_or(Literal::Bool(false));
        writeln!(out, "said {said:?}: {status}")?;
        writeln!(
            out,
            "  tries {}, colour {}, heavy {}, n_ended {}",
            value("tries"),
            value("colour"),
            value("heavy"),
            value("n_ended")
        )?;
    }
    // A script is read when the tree is built.
    if let Err(mistakes) = registry.tree(sequence([script("x := 1 +"), script("y := missing + 1")])) {
        writeln!(out, "{mistakes}")?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    run(&mut io::stdout())
}
