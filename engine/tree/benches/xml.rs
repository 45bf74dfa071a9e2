//! Cost of reading and writing 10,000 nodes; run with `cargo bench -p sfg-tree --bench xml`.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a program for developers")]

use sfg_tree::xml::{ImportOptions, export, import};
use std::fmt::Write;
use std::time::Instant;

/// A sequence of 1000 sequences of nine leaves; each leaf has a name, a constant and a key.
fn text() -> String {
    let mut text = String::from("<root BTCPP_format=\"4\">\n<BehaviorTree ID=\"T\">\n<Sequence>\n");
    for row in 0..1000 {
        text.push_str("  <Sequence>\n");
        for column in 0..9 {
            _ = writeln!(text, "    <Work name=\"work {row} {column}\" height_m=\"0.{column}\" goal=\"{{goal_{column}}}\"/>");
        }
        text.push_str("  </Sequence>\n");
    }
    text.push_str("</Sequence>\n</BehaviorTree>\n</root>\n");
    text
}

fn measure(name: &str, mut work: impl FnMut()) {
    let mut millis: Vec<f64> = (0..200)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    millis.sort_by(f64::total_cmp);
    println!("{name}: least {:.2} ms, median {:.2} ms, p95 {:.2} ms", millis[0], millis[100], millis[190]);
}

fn main() {
    let text = text();
    println!("{} bytes", text.len());
    let options = ImportOptions::default();
    let spec = import(&text, &options).unwrap().spec;
    measure("XML to spec, 10,001 nodes", || assert!(import(&text, &options).is_ok()));
    measure("spec to XML, 10,001 nodes", || assert!(export(&spec, &[]).is_ok()));
}
