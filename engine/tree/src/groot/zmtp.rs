//! The part of ZMTP 3.1, the wire protocol of ZeroMQ, that a REP and a PUB socket need, with the NULL mechanism.
//!
//! A connection begins with a greeting of 64 bytes from each side, then a READY command from each side. After that come frames:
//! flags, length, body. Frames with `more` set belong together with the next one.

use std::io::{self, Read};
use thiserror::Error;

/// Longest frame, and longest message in all its frames, that is read.
pub(super) const MAX_BYTES: usize = 1 << 20;
/// Most frames of a message that is read.
const MAX_FRAMES: usize = 32;
/// Longest command that is read.
const MAX_COMMAND_BYTES: usize = 1 << 16;
/// Bytes of a greeting.
pub(super) const GREETING_BYTES: usize = 64;

const MORE: u8 = 1;
const LONG: u8 = 2;
const COMMAND: u8 = 4;

/// Why a connection is closed.
#[derive(Debug, Error)]
pub(super) enum ZmtpError {
    #[error("the connection was lost")]
    Io(#[from] io::Error),
    #[error("a message is longer than {MAX_BYTES} bytes or {MAX_FRAMES} frames")]
    TooLong,
    #[error("{0}")]
    Malformed(&'static str),
}

/// What follows the handshake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Frame {
    Message { is_last: bool, body: Vec<u8> },
    Command { name: Vec<u8>, data: Vec<u8> },
}

/// The greeting of a server or client that speaks 3.1 without security.
pub(super) fn greeting() -> [u8; GREETING_BYTES] {
    let mut bytes = [0; GREETING_BYTES];
    (bytes[0], bytes[9], bytes[10], bytes[11]) = (0xff, 0x7f, 3, 1);
    bytes[12..16].copy_from_slice(b"NULL");
    bytes
}

/// Reads a greeting.
pub(super) fn read_greeting(reader: &mut impl Read) -> Result<(), ZmtpError> {
    let mut bytes = [0; GREETING_BYTES];
    // Piece by piece: somebody who speaks another protocol may wait after a few bytes.
    reader.read_exact(&mut bytes[..1])?;
    if bytes[0] != 0xff {
        return Err(ZmtpError::Malformed("no ZMTP signature"));
    }
    reader.read_exact(&mut bytes[1..11])?;
    if bytes[9] & 1 == 0 {
        return Err(ZmtpError::Malformed("no ZMTP signature"));
    }
    if bytes[10] < 3 {
        return Err(ZmtpError::Malformed("a ZMTP version before 3"));
    }
    reader.read_exact(&mut bytes[11..])?;
    if bytes[12..32] == *b"NULL\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0" {
        Ok(())
    } else {
        Err(ZmtpError::Malformed("another mechanism than NULL"))
    }
}

/// Reads a frame of at most `limit` bytes. Takes memory for no more than that, and only once its length was read.
pub(super) fn read_frame(reader: &mut impl Read, limit: usize) -> Result<Frame, ZmtpError> {
    let mut flags = [0];
    reader.read_exact(&mut flags)?;
    let flags = flags[0];
    if flags & !(MORE | LONG | COMMAND) != 0 || flags & (MORE | COMMAND) == MORE | COMMAND {
        return Err(ZmtpError::Malformed("unknown flags of a frame"));
    }
    let length = if flags & LONG == 0 {
        let mut length = [0];
        reader.read_exact(&mut length)?;
        u64::from(length[0])
    } else {
        let mut length = [0; 8];
        reader.read_exact(&mut length)?;
        u64::from_be_bytes(length)
    };
    let limit = if flags & COMMAND == 0 { limit } else { MAX_COMMAND_BYTES };
    let length = usize::try_from(length).ok().filter(|length| *length <= limit).ok_or(ZmtpError::TooLong)?;
    let mut body = vec![0; length];
    reader.read_exact(&mut body)?;
    if flags & COMMAND == 0 {
        return Ok(Frame::Message { is_last: flags & MORE == 0, body });
    }
    let name_length = body.first().map_or(0, |length| usize::from(*length));
    match (name_length, body.get(1..=name_length), body.get(1 + name_length..)) {
        (1.., Some(name), Some(data)) => Ok(Frame::Command { name: name.to_vec(), data: data.to_vec() }),
        _ => Err(ZmtpError::Malformed("a command without a name")),
    }
}

fn write_frame(out: &mut Vec<u8>, flags: u8, body: &[u8]) {
    match u8::try_from(body.len()) {
        Ok(length) => out.extend([flags, length]),
        Err(_longer) => {
            out.push(flags | LONG);
            out.extend((body.len() as u64).to_be_bytes());
        }
    }
    out.extend(body);
}

/// The frames of a message.
pub(super) fn message<'p>(parts: impl IntoIterator<Item = &'p [u8]>) -> Vec<u8> {
    let mut out = Vec::new();
    let mut parts = parts.into_iter().peekable();
    while let Some(part) = parts.next() {
        write_frame(&mut out, if parts.peek().is_some() { MORE } else { 0 }, part);
    }
    out
}

/// The frame of a command. Names are shorter than 256 bytes.
pub(super) fn command(name: &str, data: &[u8]) -> Vec<u8> {
    let mut body = vec![u8::try_from(name.len()).unwrap_or(u8::MAX)];
    body.extend(name.as_bytes().iter().take(usize::from(u8::MAX)));
    body.extend(data);
    let mut out = Vec::new();
    write_frame(&mut out, COMMAND, &body);
    out
}

/// The READY command of a socket of this type.
pub(super) fn ready(socket_type: &str) -> Vec<u8> {
    let mut data = Vec::new();
    data.push(11);
    data.extend(b"Socket-Type");
    data.extend(u32::try_from(socket_type.len()).unwrap_or(0).to_be_bytes());
    data.extend(socket_type.as_bytes());
    command("READY", &data)
}

/// The type of the socket that sent this data of a READY command.
pub(super) fn socket_type(mut data: &[u8]) -> Option<&[u8]> {
    while let Some((name_length, rest)) = data.split_first() {
        let (name, rest) = rest.split_at_checked(usize::from(*name_length))?;
        let (length, rest) = rest.split_first_chunk::<4>()?;
        let (value, rest) = rest.split_at_checked(usize::try_from(u32::from_be_bytes(*length)).ok()?)?;
        if name.eq_ignore_ascii_case(b"Socket-Type") {
            return Some(value);
        }
        data = rest;
    }
    None
}

/// The PONG that answers a PING with this data, or nothing when it is too short or too long.
pub(super) fn pong(ping: &[u8]) -> Option<Vec<u8>> {
    let (_time_to_live, context) = ping.split_first_chunk::<2>()?;
    (context.len() <= 16).then(|| command("PONG", context))
}

/// A PING; the peer need not keep to a time.
pub(super) fn ping() -> Vec<u8> {
    command("PING", &[0, 0])
}

/// The frames of a message that is being read.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    parts: Vec<Vec<u8>>,
    n_bytes: usize,
}

impl Assembly {
    /// Whether a message has begun and is not over.
    pub(super) fn is_open(&self) -> bool {
        !self.parts.is_empty()
    }

    /// How long the next frame may be.
    pub(super) fn n_left(&self) -> usize {
        MAX_BYTES.saturating_sub(self.n_bytes)
    }

    /// Adds a frame; gives the message when it is the last one.
    pub(super) fn add(&mut self, is_last: bool, body: Vec<u8>) -> Result<Option<Vec<Vec<u8>>>, ZmtpError> {
        self.n_bytes += body.len();
        if self.n_bytes > MAX_BYTES || self.parts.len() == MAX_FRAMES {
            return Err(ZmtpError::TooLong);
        }
        self.parts.push(body);
        if !is_last {
            return Ok(None);
        }
        self.n_bytes = 0;
        Ok(Some(std::mem::take(&mut self.parts)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(bytes: &[u8]) -> Result<Frame, String> {
        read_frame(&mut &bytes[..], MAX_BYTES).map_err(|error| error.to_string())
    }

    #[test]
    fn a_greeting_is_read_back() {
        let bytes = greeting();
        assert_eq!((&bytes[..12], &bytes[12..17]), (&b"\xff\0\0\0\0\0\0\0\0\x7f\x03\x01"[..], &b"NULL\0"[..]));
        assert!(read_greeting(&mut &bytes[..]).is_ok());
        let changed = |at: usize, byte: u8| {
            let mut bytes = greeting();
            bytes[at] = byte;
            read_greeting(&mut &bytes[..]).map_err(|error| error.to_string())
        };
        assert_eq!(changed(0, b'G'), Err("no ZMTP signature".to_owned()));
        assert_eq!(changed(9, 0), Err("no ZMTP signature".to_owned()));
        assert_eq!(changed(10, 2), Err("a ZMTP version before 3".to_owned()));
        assert_eq!(changed(10, 4), Ok(()));
        assert_eq!(changed(11, 0), Ok(()));
        assert_eq!(changed(12, b'C'), Err("another mechanism than NULL".to_owned()));
    }

    #[test]
    fn frames_are_short_or_long_and_last_or_not() {
        let long = vec![7; 256];
        let bytes = message([&b""[..], &b"ab"[..], &long[..]]);
        assert_eq!(bytes[..6], [1, 0, 1, 2, b'a', b'b']);
        assert_eq!(bytes[6..15], [2, 0, 0, 0, 0, 0, 0, 1, 0]);
        let reader = &mut &bytes[..];
        for (is_last, body) in [(false, vec![]), (false, b"ab".to_vec()), (true, long)] {
            assert_eq!(read_frame(reader, MAX_BYTES).ok(), Some(Frame::Message { is_last, body }));
        }
        assert!(reader.is_empty());
    }

    #[test]
    fn commands_have_names() {
        let expected = Frame::Command { name: b"PING".to_vec(), data: vec![0, 0] };
        assert_eq!(frame(&ping()), Ok(expected));
        assert_eq!(pong(b"\0\x05abc"), Some(b"\x04\x08\x04PONGabc".to_vec()));
        assert_eq!(pong(b"\0"), None);
        assert_eq!(pong(&[0; 19]), None);
        let Ok(Frame::Command { data, .. }) = frame(&ready("REP")) else { panic!("READY is a command") };
        assert_eq!(socket_type(&data), Some(&b"REP"[..]));
        assert_eq!(socket_type(b"\x08Identity\0\0\0\x02ab\x0bsocket-TYPE\0\0\0\x03SUB"), Some(&b"SUB"[..]));
        assert_eq!(socket_type(b"\x0bSocket-Type\0\0\0\x04SUB"), None);
    }

    #[test]
    fn what_is_no_frame_is_refused() {
        let too_long = Err("a message is longer than 1048576 bytes or 32 frames".to_owned());
        assert_eq!(frame(&[8, 0]), Err("unknown flags of a frame".to_owned()));
        assert_eq!(frame(&[5, 0]), Err("unknown flags of a frame".to_owned()));
        assert_eq!(frame(&[4, 0]), Err("a command without a name".to_owned()));
        assert_eq!(frame(&[4, 3, 9, b'a', b'b']), Err("a command without a name".to_owned()));
        assert_eq!(frame(&[2, 0, 0, 0, 0, 0, 0x10, 0, 1]), too_long);
        assert_eq!(frame(&[2, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]), too_long);
        assert_eq!(frame(&[6, 0, 0, 0, 0, 0, 1, 0, 1]), too_long);
        let mut assembly = Assembly::default();
        for _ in 0..32 {
            assert!(assembly.add(false, vec![]).is_ok_and(|message| message.is_none()));
        }
        assert!(assembly.add(true, vec![]).is_err());
    }

    /// Bytes that end, and the largest room that was made for some of them.
    struct Stream<'a> {
        bytes: &'a [u8],
        largest: usize,
    }

    impl Read for Stream<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.largest = self.largest.max(buffer.len());
            self.bytes.read(buffer)
        }
    }

    /// xorshift64*.
    struct Numbers(u64);

    impl Numbers {
        fn next(&mut self, below: u64) -> u64 {
            self.0 ^= self.0 >> 12;
            self.0 ^= self.0 << 25;
            self.0 ^= self.0 >> 27;
            (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % below
        }

        fn byte(&mut self) -> u8 {
            u8::try_from(self.next(256)).unwrap_or(0)
        }

        fn bytes(&mut self, below: u64) -> Vec<u8> {
            (0..self.next(below)).map(|_| self.byte()).collect()
        }
    }

    /// Nonsense, or what a client sends with some of it changed.
    fn stream(numbers: &mut Numbers) -> Vec<u8> {
        if numbers.next(4) == 0 {
            return numbers.bytes(200);
        }
        let mut bytes =
            [&greeting()[..], &ready(["REQ", "SUB", "DEALER"][usize::try_from(numbers.next(3)).unwrap_or(0)])].concat();
        for _ in 0..numbers.next(6) {
            match numbers.next(4) {
                0 => bytes.extend(ping()),
                1 => {
                    let (flags, length) = (numbers.byte() & 7 | LONG, numbers.next(1 << 21));
                    bytes.push(flags);
                    bytes.extend((if numbers.next(8) == 0 { u64::MAX } else { length }).to_be_bytes());
                    bytes.extend(numbers.bytes(40));
                }
                _ => {
                    let (first, second) = (numbers.bytes(40), numbers.bytes(300));
                    bytes.extend(message([&b""[..], &first, &second]));
                }
            }
        }
        for _ in 0..numbers.next(4) {
            let at = usize::try_from(numbers.next(bytes.len() as u64)).unwrap_or(0);
            bytes[at] = numbers.byte();
        }
        if numbers.next(3) == 0 {
            bytes.truncate(usize::try_from(numbers.next(bytes.len() as u64)).unwrap_or(0));
        }
        bytes
    }

    /// Reads as a server does; gives how many frames and messages there were.
    fn read_all(reader: &mut impl Read) -> (usize, usize, ZmtpError) {
        let (mut n_frames, mut n_messages, mut assembly) = (0, 0, Assembly::default());
        if let Err(error) = read_greeting(reader) {
            return (0, 0, error);
        }
        loop {
            match read_frame(reader, assembly.n_left()) {
                Ok(Frame::Command { data, .. }) => {
                    let _type = socket_type(&data);
                    let _pong = pong(&data);
                }
                Ok(Frame::Message { is_last, body }) => match assembly.add(is_last, body) {
                    Ok(message) => n_messages += usize::from(message.is_some()),
                    Err(error) => return (n_frames, n_messages, error),
                },
                Err(error) => return (n_frames, n_messages, error),
            }
            assert!(assembly.n_bytes <= MAX_BYTES);
            n_frames += 1;
        }
    }

    #[test]
    fn no_stream_makes_the_decoder_panic_take_much_memory_or_go_on_for_ever() {
        let mut numbers = Numbers(0x9e37_79b9_7f4a_7c15);
        let (mut n_all_frames, mut n_all_messages, mut largest) = (0, 0, 0);
        for _ in 0..100_000 {
            let bytes = stream(&mut numbers);
            let mut reader = Stream { bytes: &bytes, largest: 0 };
            let (n_frames, n_messages, _error) = read_all(&mut reader);
            assert!(n_frames * 2 <= bytes.len(), "every frame takes bytes off a stream that ends");
            assert!(reader.largest <= MAX_BYTES);
            (n_all_frames, n_all_messages) = (n_all_frames + n_frames, n_all_messages + n_messages);
            largest = largest.max(reader.largest);
        }
        // The streams are good enough to get deep into the protocol.
        assert!(n_all_frames > 100_000 && n_all_messages > 20_000, "{n_all_frames} frames, {n_all_messages} messages");
        assert!(largest > MAX_BYTES / 2);
    }
}
