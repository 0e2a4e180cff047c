//! Any bits are decoded to a tree or refused: the coder without the file around it.
//!
//! In crates/wrt-core, as [`wct_file`](../wct_file.rs) with `tree_code` for its name
//! and `fuzz/seeds/tree_code` to start from.
//! The first two bytes are the levels and whether light is within the UDC; the rest
//! follows a header that is in order.

#![no_main]

use libfuzzer_sys::fuzz_target;
use wrt_core::{Levels, Sampler, Tree};

fuzz_target!(|bytes: &[u8]| {
    let Some((&[levels, flags], bits)) = bytes.split_first_chunk() else { return };
    let levels = Levels { position: levels & 15, direction: levels >> 4 };
    let mut code = Vec::with_capacity(77 + bits.len());
    code.extend([0.25_f64, 0.0, 9.0, 1.0, -0.5].into_iter().flat_map(f64::to_le_bytes));
    let axes = [0.6_f32, 0.6, 0.5, -0.7, 0.7, 0.1, 0.3, -0.3, 0.9];
    code.extend(axes.into_iter().flat_map(f32::to_le_bytes));
    code.push(flags & 1);
    code.extend(bits);
    let Ok(tree) = Tree::from_code(levels, &code) else { return };
    assert!(tree.norm_squared().is_finite(), "{tree:?}");
    assert!(tree.code() == Some(&code[..]), "it remembers what it was read from");
    let masks: Vec<_> = tree.nodes().iter().map(|n| (n.child_mask, n.nu_mask)).collect();
    let again = Tree::from_parts(levels, tree.root(), &masks, tree.coefficients().to_vec());
    assert_eq!(again, Ok(tree.without_code()), "its parts are in order");
    // Finding all bricks of a fine one would take nearly all of the time.
    if levels.position + levels.direction < 5 {
        let sampler = Sampler::new(&tree);
        let _ = (sampler.box_value([0.3, 0.9, 0.6, 0.4]), sampler.multilinear([0.7, 0.1, 0.1, 0.5]));
    }
});
