//! The bytes behind a glTF's URIs: data in the URI itself, or a file beside it.

use super::super::files::Files;
use anyhow::{Context as _, bail, ensure};

/// Reads what `uri` names, one beside the scene among `files`.
///
/// # Errors
///
/// If the URI is malformed or remote, or its file cannot be read; the message
/// names the file.
pub(super) fn resolve(uri: &str, files: &Files<'_>) -> anyhow::Result<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (header, payload) = data.split_once(',').context("a data URI without a comma")?;
        return if header.ends_with(";base64") {
            decode_base64(payload).context("a data URI that is not base64")
        } else {
            decode_percent(payload).context("a malformed data URI")
        };
    }
    let remote = uri.split_once("://").map(|(scheme, _)| scheme);
    if let Some(scheme) = remote {
        bail!("{uri:?} is a {scheme} address: put the file beside the scene and name it");
    }
    let name = decode_percent(uri).and_then(|bytes| String::from_utf8(bytes).ok());
    let name = name.with_context(|| format!("{uri:?} is no valid URI"))?;
    files.read(&name).with_context(|| format!("cannot read {}", files.path(&name).display()))
}

/// Checks that `bytes` has what the file says of its length, and cuts it there.
///
/// # Errors
///
/// If it is shorter.
pub(super) fn exactly(mut bytes: Vec<u8>, length: u64) -> anyhow::Result<Vec<u8>> {
    let held = bytes.len();
    let length = usize::try_from(length).ok().filter(|&l| l <= held);
    let length = length.with_context(|| format!("it holds {held} bytes, fewer than it should"))?;
    bytes.truncate(length);
    Ok(bytes)
}

/// RFC 4648 §4; padding is optional.
fn decode_base64(text: &str) -> anyhow::Result<Vec<u8>> {
    let digits = text.trim_end_matches('=').as_bytes();
    ensure!(digits.len() % 4 != 1, "one digit too many or too few");
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    for group in digits.chunks(4) {
        let mut bits = 0_u32;
        for (i, &digit) in group.iter().enumerate() {
            let value = match digit {
                b'A'..=b'Z' => digit - b'A',
                b'a'..=b'z' => digit - b'a' + 26,
                b'0'..=b'9' => digit - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                _ => bail!("{:?} is no base64 digit", char::from(digit)),
            };
            bits |= u32::from(value) << (18 - 6 * i);
        }
        bytes.extend_from_slice(&bits.to_be_bytes()[1..group.len()]);
    }
    Ok(bytes)
}

/// RFC 3986 §2.1, or `None` if a `%` is not followed by two hexadecimal digits.
fn decode_percent(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(if byte == b'%' {
            let mut digit = || char::from(rest.next()?).to_digit(16);
            u8::try_from(16 * digit()? + digit()?).ok()?
        } else {
            byte
        });
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn data(uri: &str) -> anyhow::Result<Vec<u8>> {
        resolve(uri, &Files::beside(Path::new("nowhere")))
    }

    /// RFC 4648 §10.
    #[test]
    fn base64_test_vectors_decode() {
        for (text, expected) in [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9vYg==", "foob"),
            ("Zm9vYmE", "fooba"),
            ("Zm9vYmFy", "foobar"),
        ] {
            let uri = format!("data:application/octet-stream;base64,{text}");
            assert_eq!(data(&uri).expect("valid base64"), expected.as_bytes(), "{text}");
        }
        assert_eq!(data("data:;base64,+/+/").expect("valid base64"), [0xfb, 0xff, 0xbf]);
    }

    #[test]
    fn malformed_uris_are_errors() {
        for (uri, expected) in [
            ("data:;base64,Zm9v!", "a data URI that is not base64"),
            ("data:;base64,Zm9vY", "one digit too many"),
            ("data:nothing", "without a comma"),
            ("data:,%4", "a malformed data URI"),
            ("bad%zz.bin", "is no valid URI"),
            ("https://example.org/a.bin", "is a https address: put the file beside the scene"),
        ] {
            let text = format!("{:#}", data(uri).expect_err("malformed"));
            assert!(text.contains(expected), "{uri}: {text}");
        }
    }

    #[test]
    fn file_names_are_percent_decoded() {
        let directory = tempfile::tempdir().expect("a temporary directory");
        std::fs::write(directory.path().join("stained glass é.bin"), b"abc").expect("a file");
        let files = Files::beside(directory.path());
        let bytes = resolve("stained%20glass%20%C3%A9.bin", &files);
        assert_eq!(bytes.expect("the file is there"), b"abc");
        assert_eq!(resolve("data:,a%20b", &files).expect("text"), b"a b");
        let error = resolve("not%20there.png", &files).expect_err("no such file");
        let text = format!("{error:#}");
        assert!(text.starts_with("cannot read ") && text.contains("not there.png: "), "{text}");
    }

    #[test]
    fn short_buffers_are_errors() {
        assert_eq!(exactly(vec![1, 2, 3, 0], 3).expect("GLB pads its chunk"), [1, 2, 3]);
        for length in [4, u64::MAX] {
            assert!(exactly(vec![1, 2, 3], length).is_err(), "{length} of 3 bytes");
        }
    }
}
