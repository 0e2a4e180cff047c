//! What can go wrong in this crate.

/// A result with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can fail: a polygon no chart can cover, an option out of
/// range, or a file from outside. Broken promises by the caller panic instead.
///
/// Messages name the offending value and the bound it broke, and no path: the
/// caller knows which file or mesh it came from and adds that.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// Which vertex, from 0.
        vertex: usize,
    },
    /// Fewer than three vertices, or more than a chart takes.
    #[error("{found} vertices, where {needed} are needed")]
    VertexCount {
        /// How many there are.
        found: usize,
        /// How many there should be.
        needed: &'static str,
    },
    /// The outline encloses no area, or an edge that gives the frame has no length.
    #[error("the polygon has no area (or its first edges are parallel or of zero length)")]
    ZeroArea,
    /// A vertex is off the plane of the others.
    #[error("not planar: vertex {vertex} is {distance:e} off the plane")]
    NotPlanar {
        /// The worst vertex.
        vertex: usize,
        /// How far off, in the polygon's units.
        distance: f64,
    },
    /// Two edges cross.
    #[error("edges {first} and {second} of the outline cross")]
    SelfCrossing {
        /// The one edge, from vertex `first` to the next.
        first: usize,
        /// The other.
        second: usize,
    },
    /// A perspective or bilinear chart over this quadrilateral folds over.
    #[error("the quadrilateral is not convex at vertex {vertex}, so that a {chart} chart folds")]
    NotConvex {
        /// The reflex vertex.
        vertex: usize,
        /// Which chart.
        chart: &'static str,
    },
    /// A destination whose grid lines are curves, where whole blocks need straight ones.
    #[error("a {chart} chart bends the lines of its grid, which transport by blocks cannot follow")]
    BentGrid {
        /// Which chart.
        chart: &'static str,
    },
    /// A material that reflects what no surface can.
    #[error("{what} is {found}, but must be {allowed}")]
    Reflectance {
        /// Which parameter.
        what: &'static str,
        /// Its value.
        found: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// A sky or sun that cannot be.
    #[error("{what} is {found}, but must be {allowed}")]
    Weather {
        /// Which parameter.
        what: &'static str,
        /// Its value.
        found: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// A table of a BSDF that does not fit its directions.
    #[error("a BSDF of {incident} × {outgoing} directions, but {found} values")]
    TableSize {
        /// Patches of incident directions.
        incident: usize,
        /// Patches of outgoing directions.
        outgoing: usize,
        /// Values.
        found: usize,
    },
    /// A value in a BSDF's table that is negative or not finite.
    #[error("value {index} of the BSDF is {found}")]
    TableValue {
        /// Which, from 0.
        index: usize,
        /// What it is.
        found: f32,
    },
    /// A name that no integration method has.
    #[error("{found:?} is no integration method: {known}")]
    UnknownMethod {
        /// What was asked for.
        found: String,
        /// What there is.
        known: &'static str,
    },
    /// A sample count that an integration method cannot use.
    #[error("{found} samples, but {method} takes {allowed}")]
    SampleCount {
        /// Which method.
        method: &'static str,
        /// The count.
        found: u64,
        /// Counts it takes.
        allowed: &'static str,
    },
    /// The first eight bytes are not the magic of `.wct`.
    #[error("not a .wct file: it starts with {found:02x?}")]
    NotWct {
        /// What they are.
        found: Vec<u8>,
    },
    /// Written by a newer version of the format.
    #[error("format version {found}, but this build reads up to {newest}")]
    UnsupportedVersion {
        /// The file's version.
        found: u16,
        /// The newest one known here.
        newest: u16,
    },
    /// A field with a value no writer produces.
    #[error("{what} is {found} at byte {offset}, but must be {allowed}")]
    BadField {
        /// Which field.
        what: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        allowed: String,
        /// Where it starts, from the start of the file.
        offset: u64,
    },
    /// A checksum does not match its bytes.
    #[error("{what} at byte {offset} is damaged: its checksum does not match")]
    Checksum {
        /// Which part.
        what: String,
        /// Where it starts, from the start of the file.
        offset: u64,
    },
    /// The JSON description cannot be understood.
    #[error("the description at byte {offset} cannot be read: {reason}")]
    Description {
        /// What the parser says.
        reason: String,
        /// Where the description starts.
        offset: u64,
    },
    /// A value in the description that no writer produces.
    #[error("{path} is {found} in the description at byte {offset}, but must be {allowed}")]
    BadDescription {
        /// Which value, as in `patches[0].levels.position`.
        path: String,
        /// What it is.
        found: String,
        /// What it may be.
        allowed: String,
        /// Where the description starts.
        offset: u64,
    },
    /// A convention that a newer version may bring and this build does not know.
    #[error(
        "{what} is `{found}` in the description at byte {offset}, but this build knows only `{known}`"
    )]
    Unsupported {
        /// Which convention.
        what: String,
        /// What the file says.
        found: String,
        /// What it could say.
        known: String,
        /// Where the description starts.
        offset: u64,
    },
    /// A patch that is not a radiance on a polygon.
    #[error("patch `{patch}`{}: {reason}", at(*offset))]
    BadPatch {
        /// Its name.
        patch: String,
        /// What is wrong with it.
        reason: String,
        /// Where in a file it starts, or its description; `None` if it is not from one.
        offset: Option<u64>,
    },
    /// The file ends before what its header promises.
    #[error(
        "the file ends at byte {found}, but {needed} are promised: it is cut short or still being written"
    )]
    Truncated {
        /// How long it is.
        found: u64,
        /// How long it should be.
        needed: u64,
    },
    /// Reading or writing failed underneath.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

fn at(offset: Option<u64>) -> String {
    offset.map(|offset| format!(" at byte {offset}")).unwrap_or_default()
}
