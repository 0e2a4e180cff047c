//! The `.wct` format: golden bytes, round trips, and files that are damaged.

use wrt_core::grid::Grid;
use wrt_core::wct_file::{ChartKind, Side};
use wrt_core::{Levels, Patch, PatchGeometry, TreeBuilder, WctFile};

/// Two patches, one of them of a constant radiance.
fn tiny() -> WctFile {
    let levels = Levels { position: 1, direction: 2 };
    let image = |d: usize| {
        let texel = |p: usize| [d as f32, p as f32 * 0.25, (d * p % 3) as f32];
        (!d.is_multiple_of(5)).then(|| (0..4).map(texel).collect())
    };
    let grid = Grid::from_images(levels, (0..16).map(image).collect());
    let square = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, -1.0], [0.0, 0.0, -1.0]];
    let floor = Patch {
        name: "floor".to_owned(),
        polygon: PatchGeometry { vertices: square.to_vec(), chart: ChartKind::Rectilinear },
        side: Side::Incident,
        tree: TreeBuilder::from_grid(&grid).finish(),
        relative_error: 0.0,
        error_estimate: Some(0.001),
    };
    let constant = TreeBuilder::from_grid(&Grid::separable(
        Levels { position: 0, direction: 0 },
        vec![[0.5, 0.25, 0.125]],
        &[1.0],
    ));
    let lamp = Patch {
        name: "ceiling λ \"lamp\"".to_owned(),
        polygon: PatchGeometry { vertices: square[..3].to_vec(), chart: ChartKind::Rectilinear },
        side: Side::Outgoing,
        tree: constant.finish(),
        relative_error: 0.1,
        error_estimate: None,
    };
    WctFile {
        patches: vec![floor, lamp],
        generator: "test 1".to_owned(),
        input_hash: "crc32:00000000".to_owned(),
        options: [("levels".to_owned(), "1,2".to_owned())].into(),
    }
}

#[test]
fn a_file_comes_back_as_it_was() {
    let file = tiny();
    let bytes = file.to_bytes();
    let back = WctFile::from_bytes(&bytes).expect("its own bytes");
    assert_eq!(back, file);
    assert_eq!(back.to_bytes(), bytes);
}
