//! The first 64 bytes.

use crate::{Error, Result};

/// The first eight bytes. The high bit and the line ends catch a transfer as
/// text, as PNG's do.
pub const MAGIC: [u8; 8] = *b"\x89WCT\r\n\x1a\n";

/// The format version written, and the newest one read.
pub const MAJOR: u16 = 1;

/// The newest additions written; a reader takes any. A file that has no use for
/// them is written as of the version before.
pub const MINOR: u16 = 1;

/// Bytes of the header, and what sections are aligned to: a cache line.
pub(super) const ALIGN: usize = 64;

/// Where the header's own checksum starts.
const CHECKED: usize = 60;

/// What the header says.
#[derive(Clone, Copy, Debug)]
pub(super) struct Header {
    pub(super) minor: u16,
    pub(super) description_len: u64,
    pub(super) file_len: u64,
    pub(super) description_crc: u32,
}

impl Header {
    pub(super) fn to_bytes(self) -> [u8; ALIGN] {
        let mut bytes = [0; ALIGN];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..10].copy_from_slice(&MAJOR.to_le_bytes());
        bytes[10..12].copy_from_slice(&self.minor.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.description_len.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.file_len.to_le_bytes());
        bytes[32..36].copy_from_slice(&self.description_crc.to_le_bytes());
        let crc = crc32fast::hash(&bytes[..CHECKED]);
        bytes[CHECKED..].copy_from_slice(&crc.to_le_bytes());
        bytes
    }

    /// Reads the header at the start of `bytes`.
    pub(super) fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let start = &bytes[..bytes.len().min(MAGIC.len())];
        if !MAGIC.starts_with(start) {
            return Err(Error::NotWct { found: start.to_vec() });
        }
        let Some(header) = bytes.first_chunk::<ALIGN>() else {
            return Err(Error::Truncated { found: bytes.len() as u64, needed: ALIGN as u64 });
        };
        if crc32fast::hash(&header[..CHECKED]) != u32::from_le_bytes(field(header, CHECKED)) {
            return Err(Error::Checksum { what: "the header".to_owned(), offset: 0 });
        }
        let major = u16::from_le_bytes(field(header, 8));
        if major > MAJOR {
            return Err(Error::UnsupportedVersion { found: major, newest: MAJOR });
        }
        let bad = |what, found: u64, allowed: &str, offset| Error::BadField {
            what,
            found: found.to_string(),
            allowed: allowed.to_owned(),
            offset,
        };
        if major == 0 {
            return Err(bad("the format version", 0, "1 or more", 8));
        }
        let flags = u32::from_le_bytes(field(header, 12));
        if flags != 0 {
            return Err(bad("the flags", flags.into(), "0", 12));
        }
        let description_len = u64::from_le_bytes(field(header, 16));
        let file_len = u64::from_le_bytes(field(header, 24));
        if !description_len.is_multiple_of(ALIGN as u64) {
            return Err(bad("the description's length", description_len, "a multiple of 64", 16));
        }
        let needed = description_len.saturating_add(ALIGN as u64);
        if file_len < needed {
            let allowed = format!("at least {needed}, the end of the description");
            return Err(bad("the file's length", file_len, &allowed, 24));
        }
        if let Some(at) = header[36..CHECKED].iter().position(|&b| b != 0) {
            return Err(bad("a reserved byte", header[36 + at].into(), "0", 36 + at as u64));
        }
        let description_crc = u32::from_le_bytes(field(header, 32));
        let minor = u16::from_le_bytes(field(header, 10));
        Ok(Self { minor, description_len, file_len, description_crc })
    }
}

fn field<const N: usize>(header: &[u8; ALIGN], at: usize) -> [u8; N] {
    std::array::from_fn(|i| header[at + i])
}
