//! Any bytes are read as a `.wct` file or refused, without a panic or a huge
//! allocation.
//!
//! In crates/wrt-core, with cargo-fuzz; the variable lets a stable compiler take
//! the flags that it passes:
//!
//! ```text
//! mkdir -p fuzz/corpus/wct_file && cp ../../tests/golden/*.wct fuzz/corpus/wct_file
//! RUSTC_BOOTSTRAP=1 cargo fuzz run wct_file -- -max_len=16384 -rss_limit_mb=512
//! ```

#![no_main]

use libfuzzer_sys::fuzz_target;
use serde_json::Value;
use glam::{DVec2, DVec3};
use wrt_core::legendre::LegendreSampler;
use wrt_core::wct_file::MAGIC;
use wrt_core::{Sampler, WctFile};

fuzz_target!(|bytes: &[u8]| {
    check(bytes);
    if let Some(bytes) = sealed(bytes) {
        check(&bytes);
    }
});

/// What is read is the same when written and read again, and can be used.
fn check(bytes: &[u8]) {
    let Ok(file) = WctFile::from_bytes(bytes) else { return };
    let again = WctFile::from_bytes(&file.to_bytes()).expect("what was just written");
    assert_eq!(again, file);
    for patch in &file.patches {
        let _ = patch.polygon.to_polygon();
        // Finding all bricks of a fine one would take nearly all of the time.
        let levels = patch.tree.levels();
        if levels.position + levels.direction < 5 {
            let _ = Sampler::new(&patch.tree).multilinear([0.3, 0.9, 0.6, 0.4]);
        }
    }
    for patch in &file.smooth {
        let _ = patch.polygon.to_polygon();
        let _ = LegendreSampler::new(&patch.tree).radiance(DVec2::new(0.3, 0.9), DVec3::Z);
    }
}

/// The bytes as a file whose lengths and checksums are in order, so that the
/// checks behind those are reached.
fn sealed(bytes: &[u8]) -> Option<Vec<u8>> {
    let description_len = u64::from_le_bytes(*bytes.get(16..)?.first_chunk()?) as usize;
    let (text, data) = bytes.get(64..)?.split_at_checked(description_len)?;
    let text = match serde_json::from_slice::<Value>(text) {
        Ok(mut description) => {
            seal_sections(&mut description, data);
            description.to_string().into_bytes()
        }
        Err(_) => text.to_vec(),
    };
    let padded = text.len().next_multiple_of(64);
    let mut file = vec![0; 64];
    file[..8].copy_from_slice(&MAGIC);
    file[8..16].copy_from_slice(&bytes[8..16]);
    file.extend(text);
    file.resize(64 + padded, b' ');
    let crc = crc32fast::hash(&file[64..]);
    file.extend(data);
    let len = file.len() as u64;
    file[16..24].copy_from_slice(&(padded as u64).to_le_bytes());
    file[24..32].copy_from_slice(&len.to_le_bytes());
    file[32..36].copy_from_slice(&crc.to_le_bytes());
    let crc = crc32fast::hash(&file[..60]);
    file[60..64].copy_from_slice(&crc.to_le_bytes());
    Some(file)
}

fn seal_sections(value: &mut Value, data: &[u8]) {
    if let Value::Object(object) = value
        && let (Some(offset), Some(nbytes)) = (
            object.get("offset").and_then(Value::as_u64),
            object.get("nbytes").and_then(Value::as_u64),
        )
    {
        let bytes = data.get(offset as usize..).and_then(|rest| rest.get(..nbytes as usize));
        object.insert("crc32".to_owned(), crc32fast::hash(bytes.unwrap_or_default()).into());
    }
    match value {
        Value::Array(values) => values.iter_mut().for_each(|v| seal_sections(v, data)),
        Value::Object(object) => object.values_mut().for_each(|v| seal_sections(v, data)),
        _ => {}
    }
}
