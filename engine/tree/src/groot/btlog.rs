//! The log file that Groot2 plays back.

use super::{GrootError, MAX_NODES, alias, transition, tree_xml};
use crate::journal::{Change, Record};
use crate::tree::Tree;
use std::io::Write;

/// Format name and version.
const HEADER: &[u8; 19] = b"BTCPP4-FileLogger2\x01";

/// Writes a `.btlog` file from the journal of a tree.
///
/// | part | bytes |
/// |---|---|
/// | format name, version 1 | 19 |
/// | length of the XML, then the XML | 4 + length |
/// | start, microseconds since 1970 | 8 |
/// | each change of status: microseconds since the start, node, status | 6 + 2 + 1 |
///
/// Numbers are little-endian. Each record is one small write: hand over a [`std::io::BufWriter`] for a file.
#[derive(Debug)]
pub struct BtlogWriter<W: Write> {
    writer: W,
}

impl<W: Write> BtlogWriter<W> {
    /// A log with its header written. `xml` is the definition with `_uid` attributes, as [`tree_xml`](crate::groot::tree_xml)
    /// gives it; `start_us` the system time at which the tree's time was 0, microseconds since 1970.
    ///
    /// # Errors
    /// [`GrootError::XmlTooLong`], [`GrootError::Write`].
    pub fn create(mut writer: W, xml: &str, start_us: i64) -> Result<Self, GrootError> {
        let n_bytes = i32::try_from(xml.len()).map_err(|_too_long| GrootError::XmlTooLong { n_bytes: xml.len() })?;
        for part in [HEADER, &n_bytes.to_le_bytes()[..], xml.as_bytes(), &start_us.to_le_bytes()] {
            writer.write_all(part).map_err(|source| GrootError::Write { source })?;
        }
        Ok(Self { writer })
    }

    /// A log of this tree with its header written.
    ///
    /// # Errors
    /// [`GrootError::TooManyNodes`] besides those of [`create`](Self::create).
    pub fn for_tree<C>(writer: W, tree: &Tree<C>, start_us: i64) -> Result<Self, GrootError> {
        if tree.n_nodes() > MAX_NODES {
            return Err(GrootError::TooManyNodes { n_nodes: tree.n_nodes() });
        }
        Self::create(writer, &tree_xml(tree), start_us)
    }

    /// Writes one event if it is a change of status; the format has no others. A node that becomes idle has status 0, whatever
    /// it had before.
    ///
    /// # Errors
    /// [`GrootError::TooManyNodes`] when the node has no 16-bit number, [`GrootError::Time`], [`GrootError::Write`].
    pub fn record(&mut self, record: &Record) -> Result<(), GrootError> {
        let Change::Status { to, .. } = record.change else { return Ok(()) };
        let alias = alias(record.node).ok_or(GrootError::TooManyNodes { n_nodes: (record.node as usize).saturating_add(1) })?;
        let bytes = transition(record.now_secs, alias, to).ok_or(GrootError::Time { now_secs: record.now_secs })?;
        self.writer.write_all(&bytes).map_err(|source| GrootError::Write { source })
    }

    /// Writes events as [`Tree::drain_journal`] gives them.
    ///
    /// # Errors
    /// Those of [`record`](Self::record), of the first event that cannot be written.
    pub fn records(&mut self, records: &[Record]) -> Result<(), GrootError> {
        records.iter().try_for_each(|record| self.record(record))
    }

    /// Passes on what is buffered, so that a reader sees it.
    ///
    /// # Errors
    /// [`GrootError::Write`].
    pub fn flush(&mut self) -> Result<(), GrootError> {
        self.writer.flush().map_err(|source| GrootError::Write { source })
    }

    /// Flushes and gives the writer back.
    ///
    /// # Errors
    /// [`GrootError::Write`].
    pub fn finish(mut self) -> Result<W, GrootError> {
        self.flush()?;
        Ok(self.writer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::Status;

    fn status(node: u32, now_secs: f64) -> Record {
        Record { tick_idx: 1, now_secs, node, change: Change::Status { from: Status::Success, to: Status::Idle } }
    }

    #[test]
    fn the_header_is_followed_by_changes_of_status_alone() -> Result<(), GrootError> {
        let mut log = BtlogWriter::create(Vec::new(), "<root/>", 0x0102_0304_0506_0708)?;
        log.record(&Record { tick_idx: 1, now_secs: 0.0, node: 0, change: Change::Ticked })?;
        log.record(&status(2, 0.001))?;
        let mut expected = b"BTCPP4-FileLogger2\x01\x07\0\0\0<root/>\x08\x07\x06\x05\x04\x03\x02\x01".to_vec();
        expected.extend([0xe8, 3, 0, 0, 0, 0, 3, 0, 0]);
        assert_eq!(log.finish()?, expected);
        Ok(())
    }

    #[test]
    fn a_node_without_a_16_bit_number_is_refused() -> Result<(), GrootError> {
        let mut log = BtlogWriter::create(Vec::new(), "", 0)?;
        log.record(&status(65_534, 0.0))?;
        let error = log.record(&status(65_535, 0.0)).map_err(|error| error.to_string());
        assert_eq!(error, Err("the tree has 65536 nodes, Groot2 numbers at most 65535".to_owned()));
        assert!(matches!(log.record(&status(0, -1.0)), Err(GrootError::Time { .. })));
        Ok(())
    }
}
