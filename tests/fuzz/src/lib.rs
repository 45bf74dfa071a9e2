//! Readers that must survive every input, and the inputs.

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use sfg_scenario::{Scenario, Settings, Vocabulary};
use sfg_tree::xml::{ImportOptions, export, import};
use sfg_tree::{NodeSpec, Registry, TreeSpec};
use std::path::Path;

/// A reader under test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Scenario files.
    Yaml,
    /// BehaviorTree.CPP trees: read, built, ticked, written and read again.
    Xml,
    /// Scripts: read and run.
    Script,
}

impl Target {
    /// Every target.
    pub const ALL: [Self; 3] = [Self::Yaml, Self::Xml, Self::Script];

    /// Its name, which is also the folder of its corpus.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Yaml => "yaml",
            Self::Xml => "xml",
            Self::Script => "script",
        }
    }

    /// Words that inputs of the target are made of; they make deep mistakes more likely than single bytes do.
    fn words(self) -> &'static [&'static str] {
        match self {
            Self::Yaml => &[
                "tree:",
                "sequence:",
                "- ",
                "retry:",
                "subtree: ",
                "{",
                "}",
                "[",
                "]",
                "&a ",
                "*a",
                "<<: *a",
                "!!str ",
                "|",
                ">",
                "? ",
                ": ",
                "\"{",
                "}\"",
                "${x}",
                "${",
                "_deg",
                "include:",
                "parameters:",
                ".nan",
                ".inf",
                "1e999",
                "-",
                "#",
                "\t",
                "---",
                "...",
                "'",
                "\\u0000",
            ],
            Self::Xml => &[
                "<root>",
                "</root>",
                "<BehaviorTree ID=\"A\">",
                "</BehaviorTree>",
                "<Sequence>",
                "</Sequence>",
                "<SubTree ID=\"A\"/>",
                "<Switch2 ",
                "_skipIf=\"",
                "name=\"",
                "{=}",
                "{@a}",
                "&lt;",
                "&#0;",
                "<!--",
                "-->",
                "<![CDATA[",
                "]]>",
                "<!DOCTYPE a [<!ENTITY b \"c\">]>",
                "<?xml ?>",
                "\"",
                "/>",
            ],
            Self::Script => &[
                ":=", "+=", "==", "!=", "&&", "||", "?", ":", "(", ")", "'", "\"", "\\", "-", "--", "!", "..", "${", "%{", "[",
                "{", "\n", "#", "//", "@a", "a.b", "1e309", "0x1", "null", ";",
            ],
        }
    }

    /// Reads an input. Whether it is accepted does not matter.
    ///
    /// # Panics
    /// When the reader does, or when a tree that was written cannot be read: a find.
    pub fn try_out(self, input: &str) {
        match self {
            Self::Yaml => {
                let registry = Registry::<()>::new();
                let parsed = Scenario::parse(
                    Path::new("fuzz.yaml"),
                    input.to_owned(),
                    &Settings::default(),
                    &registry,
                    &Vocabulary::default(),
                );
                drop(parsed);
            }
            Self::Xml => {
                let Ok(imported) = import(input, &ImportOptions::default()) else { return };
                let registry = Registry::<()>::new();
                run(&registry, &imported.spec);
                if let Ok(written) = export(&imported.spec, registry.models()) {
                    let again = import(&written, &ImportOptions::default());
                    assert!(again.is_ok(), "what was written cannot be read: {written}");
                }
            }
            Self::Script => {
                let registry = Registry::<()>::new();
                let script = NodeSpec::new("script").with("code", input);
                let condition = NodeSpec::new("force_success").child(NodeSpec::new("script_condition").with("code", input));
                for node in [script, condition] {
                    let mut spec = TreeSpec::new(node).entry("a", 1).entry("b", "text");
                    spec.allows_unwritten_keys = true;
                    run(&registry, &spec);
                }
            }
        }
    }
}

fn run(registry: &Registry<()>, spec: &TreeSpec) {
    if let Ok(mut tree) = registry.build(spec) {
        for tick in 0..3 {
            tree.tick(f64::from(tick), &mut ());
        }
        tree.halt(&mut ());
    }
}

/// The inputs that mutants of a target are made from, by file name: its corpus, shipped scenarios, trees of tests.
///
/// # Errors
/// When a folder cannot be read.
pub fn corpus(target: Target) -> std::io::Result<Vec<(String, String)>> {
    let others: &[&str] = match target {
        Target::Yaml => &["../../scenarios", "../e2e/scenarios"],
        Target::Xml => &["../../engine/tree/tests/xml"],
        Target::Script => &[],
    };
    let own = format!("corpus/{}", target.name());
    let mut inputs = Vec::new();
    for folder in others.iter().copied().chain([own.as_str()]) {
        for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(folder))? {
            let path = entry?.path();
            let is_input = path.extension().is_some_and(|extension| extension == target.name() || extension == "txt");
            if is_input && path.is_file() {
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                inputs.push((name, String::from_utf8_lossy(&std::fs::read(&path)?).into_owned()));
            }
        }
    }
    inputs.sort();
    Ok(inputs)
}

/// A changed copy of one of the inputs.
pub fn mutant(target: Target, inputs: &[(String, String)], random: &mut ChaCha8Rng) -> String {
    let pick = |random: &mut ChaCha8Rng| &inputs[random.random_range(0..inputs.len())].1;
    let mut text: Vec<char> = pick(random).chars().collect();
    for _ in 0..random.random_range(1..8) {
        let at = random.random_range(0..=text.len());
        let n = random.random_range(0..=(text.len() - at).min(40));
        match random.random_range(0..7) {
            0 => drop(text.drain(at..at + n)),
            1 => {
                let copied: Vec<char> = text[at..at + n].to_vec();
                let to = random.random_range(0..=text.len());
                text.splice(to..to, copied);
            }
            2 => {
                let words = target.words();
                let word = words[random.random_range(0..words.len())];
                text.splice(at..at, word.chars());
            }
            3 => {
                let letter = char::from_u32(random.random_range(0..0x250)).unwrap_or(' ');
                text.splice(at..at, [letter]);
            }
            4 => {
                // A part of another input.
                let other: Vec<char> = pick(random).chars().collect();
                let from = random.random_range(0..=other.len());
                let to = from + random.random_range(0..=(other.len() - from).min(200));
                text.splice(at..at, other[from..to].iter().copied());
            }
            5 => {
                // The same many times, for what nests.
                let part: Vec<char> = text[at..at + n.min(8)].to_vec();
                let many: Vec<char> = part.iter().copied().cycle().take(part.len() * random.random_range(1..200)).collect();
                text.splice(at..at, many);
            }
            _ => {
                if at < text.len() {
                    text[at] = char::from(random.random_range(b' '..=b'~'));
                }
            }
        }
        text.truncate(20_000);
    }
    text.into_iter().collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use rand::SeedableRng as _;
    use std::time::{Duration, Instant};

    #[track_caller]
    fn check(target: Target) {
        let inputs = corpus(target).unwrap();
        assert!(inputs.len() >= 4);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mutants: Vec<String> = (0..1_000).map(|_| mutant(target, &inputs, &mut random)).collect();
        for input in inputs.iter().map(|(_, input)| input).chain(&mutants) {
            let begun = Instant::now();
            target.try_out(input);
            assert!(begun.elapsed() < Duration::from_secs(5), "{input}");
        }
    }

    #[test]
    fn yaml_survives() {
        check(Target::Yaml);
    }

    #[test]
    fn xml_survives() {
        check(Target::Xml);
    }

    #[test]
    fn scripts_survive() {
        check(Target::Script);
    }
}
