//! The records of an MCAP file, as far as they can be read: of a file that was cut off every record that was written out whole.

use mcap::records::{Record, op};

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Operation code and length before each record.
const HEAD: usize = 9;

/// Whether these are the bytes of an MCAP file.
pub(crate) fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The records in the order of the file, those of chunks in the place of their chunk.
pub(crate) struct Scan<'a> {
    /// What is left of the file after the record that comes next.
    rest: &'a [u8],
    /// What is left of the chunk that is being read.
    chunk: &'a [u8],
    /// The file ends as a file does that was closed.
    pub(crate) is_whole: bool,
    /// Bytes that hold nothing readable.
    pub(crate) n_lost: usize,
}

impl<'a> Scan<'a> {
    /// Begins after the magic bytes.
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes.get(MAGIC.len()..).unwrap_or_default(), chunk: &[], is_whole: false, n_lost: 0 }
    }

    /// The next record of the chunk at hand; a broken one ends the chunk.
    fn next_in_chunk(&mut self) -> Option<Record<'a>> {
        while !self.chunk.is_empty() {
            let Some((opcode, body, rest)) = split(self.chunk) else {
                self.n_lost += self.chunk.len();
                self.chunk = &[];
                break;
            };
            self.chunk = rest;
            match mcap::parse_record(opcode, body) {
                Ok(record) => return Some(record),
                Err(_) => self.n_lost += HEAD + body.len(),
            }
        }
        None
    }

    /// Opens a chunk; one whose check sum does not fit is left out.
    fn open_chunk(&mut self, body: &'a [u8]) {
        let Ok(Record::Chunk { header, data }) = mcap::parse_record(op::CHUNK, body) else {
            self.n_lost += body.len();
            return;
        };
        let data = match data {
            std::borrow::Cow::Borrowed(data) => data,
            // Records that are lent are never copied by the parser.
            std::borrow::Cow::Owned(_) => &[],
        };
        let is_sound = header.uncompressed_crc == 0 || crc32(data) == header.uncompressed_crc;
        if header.compression.is_empty() && is_sound {
            self.chunk = data;
        } else {
            self.n_lost += body.len();
        }
    }

    /// The end of a file whose writer was killed: its last chunk has no length yet.
    fn open_unfinished(&mut self) {
        let rest = std::mem::take(&mut self.rest);
        self.n_lost += rest.len();
        // Three times, a check sum, the name of the compression (none), the length of the records.
        const CHUNK_HEAD: usize = 8 + 8 + 8 + 4 + 4 + 8;
        if let Some((&op::CHUNK, body)) = rest.split_first()
            && let Some(records) = body.get(8 + CHUNK_HEAD..)
            && body.get(8 + 28..8 + 32) == Some(&[0; 4])
        {
            self.n_lost = self.n_lost.saturating_sub(records.len());
            self.chunk = records;
        }
    }
}

/// Operation code, body and what follows.
fn split(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (opcode, rest) = bytes.split_first()?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (body, rest) = rest.split_at_checked(length)?;
    Some((*opcode, body, rest))
}

/// The check sum of MCAP chunks.
fn crc32(bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(bytes);
    hasher.finalize()
}

impl<'a> Iterator for Scan<'a> {
    type Item = Record<'a>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(record) = self.next_in_chunk() {
                return Some(record);
            }
            if self.rest == MAGIC {
                self.rest = &[];
                self.is_whole = true;
            }
            if self.rest.is_empty() {
                return None;
            }
            let Some((opcode, body, rest)) = split(self.rest) else {
                self.open_unfinished();
                continue;
            };
            self.rest = rest;
            if opcode == op::CHUNK {
                self.open_chunk(body);
                continue;
            }
            match mcap::parse_record(opcode, body) {
                Ok(record) => return Some(record),
                Err(_) => self.n_lost += HEAD + body.len(),
            }
        }
    }
}
