//! The shipped scenarios, damaged in every way that a slip of the hand can: nothing is accepted silently, and what is said
//! points to the damage.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and say what they measured")]

use super::*;
use rand::seq::IndexedRandom as _;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Everything that `check` needs, loaded once.
struct Bench {
    assets: Assets,
    registry: Registry<SkillContext>,
    vocabulary: Vocabulary,
    profile: HandProfile,
}

impl Bench {
    fn new() -> Self {
        let assets = Assets::open(Some(&repository("scenarios"))).unwrap();
        let model = RobotModel::load(&assets.robots["curi"]).unwrap();
        let (registry, vocabulary) = (node_registry(), vocabulary(&assets));
        Self { assets, registry, vocabulary, profile: model.hand_profile.unwrap() }
    }

    /// What `check` finds, and what the scenario means if it can be used.
    fn check(&self, path: &Path, text: &str) -> (Vec<Mistake>, Option<String>) {
        let settings = Settings::default();
        match Scenario::parse(path, text.to_owned(), &settings, &self.registry, &self.vocabulary) {
            Err(errors) => {
                assert!(errors.to_string().contains("error: "), "{errors}");
                (errors.list().to_vec(), None)
            }
            Ok(scenario) => {
                let mut found = scenario.warnings.list().to_vec();
                found.extend(mistakes(&scenario, &self.assets, &self.profile));
                (found, Some(meaning(&scenario)))
            }
        }
    }
}

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// Every shipped scenario with its text.
fn scenarios() -> Vec<(PathBuf, String)> {
    let mut paths = Vec::new();
    for folder in ["scenarios", "tests/e2e/scenarios"] {
        let files = std::fs::read_dir(repository(folder)).unwrap().map(|entry| entry.unwrap().path());
        paths.extend(files.filter(|path| path.extension().is_some_and(|extension| extension == "yaml")));
    }
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), std::fs::read_to_string(path).unwrap())).collect()
}

/// A scenario without the places where things were written.
fn meaning(scenario: &Scenario) -> String {
    let Scenario { robot, arm, scene, instruction, plugins, tree, success, limits, .. } = scenario;
    let whole = format!("{robot:?} {arm:?} {scene:?} {instruction:?} {plugins:?} {tree:?} {success:?} {limits:?}");
    let mut rest = whole.as_str();
    let mut stripped = String::new();
    while let Some(at) = rest.find("Place {").into_iter().chain(rest.find("location: ")).min() {
        stripped.push_str(&rest[..at]);
        let end = if rest[at..].starts_with("Place") {
            rest[at..].find('}')
        } else {
            rest[at + 10..].find([',', ' ', ')']).map(|end| end + 9)
        };
        rest = &rest[at + end.unwrap() + 1..];
    }
    stripped + rest
}

/// A key of a text with its value.
#[derive(Clone, Debug)]
struct Entry {
    key: Range<usize>,
    value: Range<usize>,
    /// Whether it stands between braces.
    is_flow: bool,
    /// Key of the map that it is in.
    parent: Option<Range<usize>>,
}

/// Every key, found without a YAML parser, so that the checker is not measured by itself.
fn entries(text: &str) -> Vec<Entry> {
    let bytes = text.as_bytes();
    let (mut entries, mut depth, mut quoted, mut at) = (Vec::<Entry>::new(), 0_usize, false, 0);
    while at < bytes.len() {
        match bytes[at] {
            b'#' if !quoted => at += text[at..].find('\n').unwrap_or(text.len() - at),
            b'"' => quoted = !quoted,
            b'{' | b'[' if !quoted => depth += 1,
            b'}' | b']' if !quoted => depth -= 1,
            byte if !quoted && byte.is_ascii_alphabetic() && (at == 0 || b" \n{[".contains(&bytes[at - 1])) => {
                let n = text[at..].find(|letter: char| !letter.is_ascii_alphanumeric() && letter != '_').unwrap_or(0);
                let after = &text[at + n..];
                if after.starts_with(": ") || after.starts_with(":\n") {
                    let value = value_after(text, at, at + n + 1, depth > 0);
                    let parent = entries.iter().filter(|entry| entry.value.contains(&at)).min_by_key(|entry| entry.value.len());
                    let parent = parent.map(|entry| entry.key.clone());
                    entries.push(Entry { key: at..at + n, value, is_flow: depth > 0, parent });
                }
                at += n.max(1) - 1;
            }
            _ => {}
        }
        at += 1;
    }
    entries
}

fn value_after(text: &str, key: usize, colon: usize, is_flow: bool) -> Range<usize> {
    let line_end = |at: usize| text[at..].find('\n').map_or(text.len(), |end| at + end);
    if is_flow {
        let (mut depth, mut quoted, mut end) = (0_i32, false, colon);
        for (offset, byte) in text.bytes().enumerate().skip(colon) {
            match byte {
                b'"' => quoted = !quoted,
                b'{' | b'[' if !quoted => depth += 1,
                b'}' | b']' if !quoted => depth -= 1,
                _ => {}
            }
            end = offset;
            if depth < 0 || (depth == 0 && byte == b',' && !quoted) {
                break;
            }
        }
        return colon + 1..end;
    }
    let end = line_end(colon);
    if !text[colon..end].trim().is_empty() {
        return colon + 1..end;
    }
    let column = column_of(text, key) - 1;
    let (mut last, mut at) = (end, end + 1);
    while at < text.len() {
        let line = &text[at..line_end(at)];
        let indent = line.len() - line.trim_start().len();
        if !line.trim().is_empty() && (indent < column || (indent == column && !line.trim_start().starts_with("- "))) {
            break;
        }
        // A list item at the key's own column belongs to the key only where the key itself is no list item.
        if indent == column && text[line_start(text, key)..key].contains("- ") {
            break;
        }
        last = line_end(at);
        at = last + 1;
    }
    let start = end + 1 + text[(end + 1).min(text.len())..].find(|letter: char| letter != ' ').unwrap_or(0);
    start.min(last)..last
}

fn line_start(text: &str, at: usize) -> usize {
    text[..at].rfind('\n').map_or(0, |end| end + 1)
}

fn line_of(text: &str, at: usize) -> usize {
    1 + text[..at].matches('\n').count()
}

fn column_of(text: &str, at: usize) -> usize {
    1 + text[line_start(text, at)..at].chars().count()
}

/// A damaged text, and where the damage is: lines and columns that may rightly be named.
struct Mutant {
    what: String,
    text: String,
    lines: BTreeSet<usize>,
    columns: BTreeSet<usize>,
}

/// Words that a scenario cannot do without where they stand.
const NEEDED: &str = "version robot scene tree objects at x_m y_m model q_rad attempts container at_least object at_least_m secs";

fn mutants(text: &str, random: &mut ChaCha8Rng) -> Vec<Mutant> {
    let mut mutants = Vec::new();
    let all = entries(text);
    for entry in &all {
        let (key, value) = (&text[entry.key.clone()], &text[entry.value.clone()]);
        let mut add = |kind: &str, range: Range<usize>, new: &str, points: &[usize]| {
            let mutated = format!("{}{new}{}", &text[..range.start], &text[range.end..]);
            let points = points.iter().filter(|point| **point <= mutated.len());
            let (lines, columns) = points.map(|point| (line_of(&mutated, *point), column_of(&mutated, *point))).unzip();
            let what = format!("{kind} {key:?} in line {}", line_of(text, entry.key.start));
            mutants.push(Mutant { what, text: mutated, lines, columns });
        };
        let (from, to) = (entry.key.start, entry.key.end);
        let (letter, swap) = (random.random_range(0..key.len()), random.random_range(0..key.len().max(2) - 1));
        let mut swapped: Vec<char> = key.chars().collect();
        if swapped.len() > 1 {
            swapped.swap(swap, swap + 1);
        }
        let dropped = format!("{}{}", &key[..letter], &key[letter + 1..]);
        let renames = [
            dropped,
            swapped.into_iter().collect(),
            format!("{key}x"),
            "whatever".to_owned(),
            format!("{key}s"),
            key.to_uppercase(),
        ];
        for name in renames.iter().filter(|name| !name.is_empty() && *name != key) {
            add("rename", from..to, name, &[from]);
        }
        // Without its key the value stands where the key stood, or the map around it lacks a key.
        let around: Vec<usize> = entry.parent.iter().map(|parent| parent.start).chain([from, line_start(text, from)]).collect();
        let bare_from = if text[to..].starts_with(": ") { to + 2 } else { to + 1 };
        let value_start = entry.value.start.max(bare_from) - (bare_from - from);
        add("bare", from..bare_from, "", &[around.as_slice(), &[value_start, value_start + 1]].concat());
        if NEEDED.split(' ').any(|needed| needed == key) {
            let end = entry.value.end;
            let comma = if entry.is_flow && text[end..].starts_with(", ") { 2 } else { 0 };
            let siblings = all.iter().filter(|other| other.parent == entry.parent).map(|other| other.key.start);
            let n_removed = end + comma - from;
            let first =
                siblings.filter(|start| *start != from).min().map(|start| if start < from { start } else { start - n_removed });
            add("remove", from..end + comma, "", &around.iter().copied().chain(first).collect::<Vec<_>>());
        }
        let indent = " ".repeat(column_of(text, from) - 1);
        for again in [value.trim_end(), " 1"] {
            let is_nested = again.len() == value.trim_end().len()
                && entry.value.start > line_start(text, from)
                && line_of(text, entry.value.start) > line_of(text, from);
            let again = if is_nested { text[to + 1..entry.value.end].to_owned() } else { format!(" {}", again.trim()) };
            let copy = if entry.is_flow { format!(", {key}:{again}") } else { format!("\n{indent}{key}:{again}") };
            let at = entry.value.end;
            let second = at + copy.find(key).unwrap();
            add("twice", at..at, &copy, &[second, second + key.len() + 2]);
        }
        let first = value.trim().chars().next().unwrap_or(' ');
        let is_nested = line_of(text, entry.value.start) > line_of(text, from);
        let new_types: &[&str] = match first {
            // An angle may be a number as well.
            _ if value.trim_matches([' ', '}']) == "any" => &["true", "[]", "{}", ""],
            '[' => &["abc", "true", "{}", ""],
            '-' if is_nested => &["abc", "true", "{}", "", "7"],
            '{' => &["abc", "true", "[]", "", "7"],
            _ if is_nested => &["abc", "true", "[]", "", "7"],
            '0'..='9' | '-' => &["abc", "true", "[]", "{}", ""],
            _ => &["7", "true", "[]", "{}", ""],
        };
        let range = to + 1..entry.value.end;
        for new in new_types.iter().chain(&[".nan", "-.inf"]) {
            let kind = if new.ends_with("nan") || new.ends_with("inf") { "nan" } else { "retype" };
            add(kind, range.clone(), &format!(" {new}"), &[from, to + 2, to + 1]);
        }
        if first == '[' {
            let item = entry.value.start + value.find('[').unwrap() + 1;
            let n = text[item..].find([',', ']']).unwrap();
            add("nan", item..item + n, ".nan", &[from, item, item - 1]);
        }
        let start = line_start(text, from);
        let is_first = text[start..from].trim_matches(['-', ' ']).is_empty();
        for n in [1, 2] {
            if is_first && text[start..].starts_with(&" ".repeat(n)) {
                let dash = start + text[start..].find(|letter| letter != ' ').unwrap();
                add("dedent", start..start + n, "", &[from - n, dash - n, start]);
            }
        }
    }
    let mut seen = BTreeSet::from([text.to_owned()]);
    mutants.retain(|mutant| seen.insert(mutant.text.clone()));
    mutants
}

#[test]
fn every_slip_is_reported_where_it_was_made() {
    let bench = Bench::new();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let (mut n, mut n_line, mut n_column, mut n_same) = (0, 0, 0, 0);
    let (mut silent, mut misses) = (Vec::new(), BTreeMap::<String, Vec<String>>::new());
    for (path, text) in scenarios() {
        let (found, original) = bench.check(&path, &text);
        assert!(found.is_empty(), "{}: {found:?}", path.display());
        for mutant in mutants(&text, &mut random) {
            let (found, meaning) = bench.check(&path, &mutant.text);
            let name = format!("{}: {}", path.file_name().unwrap().to_string_lossy(), mutant.what);
            if found.is_empty() {
                if meaning == original {
                    n_same += 1;
                } else {
                    silent.push(name);
                }
                continue;
            }
            n += 1;
            let on_line = |mistake: &&Mistake| mutant.lines.contains(&(mistake.place.line as usize)) && mistake.place.file == 0;
            let is_line = found.iter().any(|mistake| on_line(&mistake));
            let is_column = found.iter().filter(on_line).any(|mistake| mutant.columns.contains(&(mistake.place.column as usize)));
            n_line += usize::from(is_line);
            n_column += usize::from(is_column);
            if !is_column {
                let said: Vec<String> = found
                    .iter()
                    .map(|mistake| format!("{}:{} {}", mistake.place.line, mistake.place.column, mistake.message))
                    .collect();
                let kind = if is_line { "column" } else { "line" };
                misses.entry(kind.to_owned()).or_default().push(format!("{name}: {}", said.join("; ")));
            }
        }
    }
    for (kind, misses) in &misses {
        println!("wrong {kind}: {}", misses.len());
        misses.iter().for_each(|miss| println!("  {miss}"));
    }
    println!("{n} mutants refused or warned of, {n_same} mean the same; line right {n_line}, column right {n_column}");
    assert!(silent.is_empty(), "accepted silently: {silent:#?}");
    assert!(n >= 2000, "only {n} mutants");
    assert!(n_line * 100 >= n * 98, "line right in {n_line} of {n}");
    assert!(n_column * 100 >= n * 90, "column right in {n_column} of {n}");
}

/// Bytes that mean something in YAML and in the language of scenarios.
const SIGNS: &[&str] = &[
    "{", "}", "[", "]", ":", " ", "-", "&a ", "*a", "!", "|", ">", "'", "\"", "%", "@", "`", "\n", "\t", "#", ",", "${",
    "${a:-1}", "}", "\u{e9}", "\0",
];

/// Damages the shipped scenarios at random; every outcome but a panic or a long silence is fine.
fn fuzz(n_runs: u64) {
    let bench = Bench::new();
    let scenarios = scenarios();
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut longest = Duration::ZERO;
    for run in 0..n_runs {
        let (path, text) = scenarios.choose(&mut random).unwrap();
        let mut text = text.clone();
        for _ in 0..random.random_range(1..5) {
            damage(&mut text, &mut random);
        }
        let begun = Instant::now();
        drop(bench.check(path, &text));
        longest = longest.max(begun.elapsed());
        assert!(begun.elapsed() < Duration::from_secs(1), "run {run} took {:?}:\n{text}", begun.elapsed());
    }
    println!("{n_runs} damaged scenarios, the longest took {longest:?}");
}

fn damage(text: &mut String, random: &mut ChaCha8Rng) {
    let mut place = |text: &str| {
        let mut at = random.random_range(0..=text.len());
        while !text.is_char_boundary(at) {
            at -= 1;
        }
        at
    };
    let (a, b) = (place(text), place(text));
    let (a, b) = (a.min(b), a.max(b).min(a.min(b) + 60));
    let b = (b..=text.len()).find(|at| text.is_char_boundary(*at)).unwrap_or(text.len());
    let lines: Vec<String> = text.lines().map(str::to_owned).collect();
    match random.random_range(0..6) {
        0 => text.insert_str(a, SIGNS.choose(random).unwrap()),
        1 => text.replace_range(a..b, ""),
        2 => text.replace_range(a..b, SIGNS.choose(random).unwrap()),
        3 => {
            let copy = text[a..b].to_owned();
            text.push_str(&copy);
        }
        kind if lines.len() > 1 => {
            let (from, to) = (random.random_range(0..lines.len()), random.random_range(0..lines.len()));
            let mut lines = lines;
            let line = lines[from].clone();
            match kind {
                4 => lines.insert(to, line),
                _ => lines[to] = format!("{}{}", " ".repeat(random.random_range(0..8)), line.trim_start()),
            }
            *text = lines.join("\n");
        }
        _ => {}
    }
}

#[test]
fn damaged_scenarios_never_panic_and_never_take_long() {
    fuzz(5_000);
}
