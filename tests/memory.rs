//! Reading a `.wct` takes no more memory than the documented multiples of its size,
//! whatever it holds.

use peak_alloc::PeakAlloc;
use wrt_core::grid::Grid;
use wrt_core::wct_file::{ChartKind, Side};
use wrt_core::{Levels, Patch, PatchGeometry, Tree, TreeBuilder, WctFile};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Of files whose trees are not coded, in times their size; see
/// [`wrt_core::wct_file`].
const RAW: usize = 16;
/// Of coded trees, in times the size of their code.
const CODED: usize = 6000;
/// What the models of a coded tree need whatever its size.
const MODELS: usize = 1 << 20;

/// Bytes allocated at once, beyond those before, while `work` runs.
fn peak<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let made = work();
    (MEMORY.peak_usage() - before, made)
}

/// Light that leaves no coefficient out, in half of the directions.
fn rough(levels: Levels) -> Tree {
    let mut state = 1_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let images = (0..levels.directions())
        .map(|d| (d % 2 == 0).then(|| (0..levels.positions()).map(|_| [random(); 3]).collect()));
    TreeBuilder::from_grid(&Grid::from_images(levels, images.collect())).finish()
}

fn file(patches: usize, tree: &Tree) -> Vec<u8> {
    let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, -1.0]];
    let patch = |i: usize| Patch {
        name: i.to_string(),
        polygon: PatchGeometry { vertices: triangle.to_vec(), chart: ChartKind::Rectilinear },
        side: Side::Outgoing,
        tree: tree.clone(),
        relative_error: 0.0,
        error_estimate: None,
    };
    WctFile { patches: (0..patches).map(patch).collect(), ..WctFile::default() }.to_bytes()
}

/// One test: others beside it would be counted.
#[test]
fn reading_needs_no_more_memory_than_it_says() {
    // Whatever threads and tables need once.
    let _ = WctFile::from_bytes(&file(1, &rough(Levels::isotropic(1)).quantised(0.1).0));
    let mut most = [0.0_f64; 2];
    let levels = Levels { position: 3, direction: 3 };
    let constant = TreeBuilder::from_grid(&Grid::separable(
        Levels::isotropic(0),
        vec![[0.5, 0.25, 0.125]],
        &[1.0],
    ))
    .finish();
    for (patches, tree) in [(1, rough(levels)), (5, rough(levels)), (1000, constant)] {
        let bytes = file(patches, &tree);
        let (used, back) = peak(|| WctFile::from_bytes(&bytes));
        assert!(back.is_ok(), "{:?}", back.err());
        assert!(used <= RAW * bytes.len(), "{used} for {} bytes, raw", bytes.len());
        most[0] = most[0].max(used as f64 / bytes.len() as f64);
    }
    for error in [0.003, 0.03, 0.3] {
        let bytes = file(3, &rough(levels).quantised(error).0);
        let (used, back) = peak(|| WctFile::from_bytes(&bytes));
        assert!(back.is_ok(), "{:?}", back.err());
        let allowed = CODED * bytes.len() + MODELS * rayon::current_num_threads().min(3);
        assert!(used <= allowed, "{used} for {} bytes, coded", bytes.len());
        most[1] = most[1].max(used as f64 / bytes.len() as f64);
    }
    // Codes that stand for as much as bits can: of one bit's value, and of no pattern.
    let header = rough(Levels::isotropic(1)).quantised(0.1).0;
    let header = &header.code().expect("its code")[..77];
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    for count in [100, 1000, 30_000] {
        let noise: Vec<u8> = (0..count).map(|_| random()).collect();
        for bits in [vec![0; count], vec![255; count], noise] {
            for levels in [Levels::isotropic(16), Levels { position: 0, direction: 16 }] {
                let bytes = [header, &bits].concat();
                let (used, _) = peak(|| Tree::from_code(levels, &bytes));
                let allowed = CODED * bytes.len() + MODELS;
                assert!(used <= allowed, "{used} for {} bytes of {}", bytes.len(), bits[0]);
                most[1] = most[1].max(used as f64 / bytes.len() as f64);
            }
        }
    }
    println!("at most {:.1} times the bytes of raw files, {:.0} of coded trees", most[0], most[1]);
}
