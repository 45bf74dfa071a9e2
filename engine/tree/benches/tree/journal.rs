//! A and C with a journal that is drained after each tick; E1 with every record written to a file.

use crate::report::{Bench, Report, folder, timed};
use crate::trees::{Context, N_LEAVES, N_NODES, counting, flat, mixed, registry, rows, start_counters};
use sfg_tree::{Change, JournalLevel, Literal, Record, Status, Tree, TreeSpec};
use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};

/// The file begins anew after so many ticks, so that it stays small.
const N_TICKS_A_FILE: usize = 100;

pub(crate) fn run(report: &mut Report) {
    let plain = rows(100, mixed);
    let with_ports = flat(counting);
    let node = |name| Bench::each(name, "ns/node", N_NODES);
    let leaf = |name| Bench::each(name, "ns/node", N_LEAVES);
    drained(report, node("A with journal: transitions"), &plain, JournalLevel::Transitions);
    drained(report, node("A with journal: writes"), &plain, JournalLevel::Writes);
    drained(report, node("A with journal: values").target(250.0), &plain, JournalLevel::Values);
    drained(report, leaf("C with journal: writes"), &with_ports, JournalLevel::Writes);
    drained(report, leaf("C with journal: values"), &with_ports, JournalLevel::Values);
    to_file(report, node("E1 A, values to a file").target(250.0), &plain);
    to_file(report, leaf("E1 C, values to a file"), &with_ports);
}

fn make(spec: &TreeSpec, level: JournalLevel) -> Tree<Context> {
    let mut tree = registry().build(spec).unwrap();
    start_counters(&mut tree);
    tree.set_journal_level(level);
    tree
}

fn drained(report: &mut Report, bench: Bench, spec: &TreeSpec, level: JournalLevel) {
    if !report.wants(bench.name) {
        return;
    }
    let (mut tree, mut context, mut n_records) = (make(spec, level), Context::new(), 0);
    report.run(bench, |sample_idx| {
        timed(|| {
            assert_eq!(tree.tick(sample_idx as f64 * 0.01, &mut context), Status::Success);
            // Dropping the records is part of the price.
            n_records = tree.drain_journal().len();
        })
    });
    println!("{:46} {n_records} records a tick", "");
    report.mix(context.sum ^ n_records as u64);
}

fn to_file(report: &mut Report, bench: Bench, spec: &TreeSpec) {
    if !report.wants(bench.name) {
        return;
    }
    let (mut tree, mut context) = (make(spec, JournalLevel::Values), Context::new());
    let path = folder().join("journal.bin");
    let mut file = BufWriter::new(File::create(&path).unwrap());
    let mut n_bytes = 0;
    report.run(bench, |sample_idx| {
        if sample_idx.is_multiple_of(N_TICKS_A_FILE) {
            file.seek(SeekFrom::Start(0)).unwrap();
        }
        timed(|| {
            assert_eq!(tree.tick(sample_idx as f64 * 0.01, &mut context), Status::Success);
            n_bytes = tree.drain_journal().iter().map(|record| write_record(&mut file, record).unwrap()).sum();
            // A tick is in the hands of the system before the next one begins.
            file.flush().unwrap();
        })
    });
    println!("{:46} {n_bytes} bytes a tick", "");
    report.mix(context.sum ^ n_bytes as u64);
    drop(file);
    std::fs::remove_file(path).unwrap();
}

/// The record's numbers as they are; how many bytes these were.
fn write_record(file: &mut impl Write, record: &Record) -> io::Result<usize> {
    let mut head = [0; 22];
    head[..8].copy_from_slice(&record.tick_idx.to_le_bytes());
    head[8..16].copy_from_slice(&record.now_secs.to_bits().to_le_bytes());
    head[16..20].copy_from_slice(&record.node.to_le_bytes());
    match &record.change {
        Change::Status { from, to } => {
            head[20..].copy_from_slice(&[*from as u8, 0x10 + *to as u8]);
            file.write_all(&head)?;
            Ok(head.len())
        }
        Change::Write { slot, value } => {
            head[20] = 0x20;
            file.write_all(&head)?;
            file.write_all(&slot.to_le_bytes())?;
            let n_value = match value.as_deref() {
                Some(Literal::Int(number)) => write_sized(file, &number.to_le_bytes())?,
                Some(Literal::Float(number)) => write_sized(file, &number.to_bits().to_le_bytes())?,
                Some(other) => write_sized(file, other.to_string().as_bytes())?,
                None => write_sized(file, &[])?,
            };
            Ok(head.len() + 4 + n_value)
        }
        Change::Failed(failure) => {
            head[20] = 0x30;
            file.write_all(&head)?;
            Ok(head.len() + write_sized(file, failure.reason.as_bytes())? + write_sized(file, failure.detail.as_bytes())?)
        }
        Change::Ticked | Change::HaltAsked | Change::Forced(_) | Change::Postponed { .. } => {
            head[20] = if record.change == Change::Ticked { 0x40 } else { 0x50 };
            file.write_all(&head)?;
            Ok(head.len())
        }
    }
}

fn write_sized(file: &mut impl Write, bytes: &[u8]) -> io::Result<usize> {
    file.write_all(&u32::try_from(bytes.len()).map_err(io::Error::other)?.to_le_bytes())?;
    file.write_all(bytes)?;
    Ok(4 + bytes.len())
}
