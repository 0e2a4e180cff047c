//! BSDFs as LBNL's XML files hold them: Klems matrices of WINDOW and genBSDF, and
//! genBSDF's tensor trees of rank 3 and 4 (`windows.lbl.gov/BSDF-v1.4.xsd`).
//!
//! A file's "front" is outdoors, so that light comes in by its `Transmission Front`.
//! Where only `Transmission Back` is given, reciprocity f(s, r) = f(r, s) stands in. Of
//! several wavelengths, `Visible` or else the first is taken.

mod tensor;

use anyhow::{Context as _, bail, ensure};
use roxmltree::{Document, Node};
use std::path::Path;
use wrt_core::{Bsdf, Patches, Ring};

/// Most bytes of a file: a rank 4 tree of level 6 in full has 16.8 million values.
const MOST_BYTES: u64 = 400 << 20;

/// The light that comes in through a window of this BSDF.
///
/// # Errors
///
/// If the file cannot be read or is not such a BSDF; the element at fault is named.
pub(super) fn read(path: &Path) -> anyhow::Result<Bsdf> {
    let bytes = std::fs::metadata(path)?.len();
    ensure!(bytes <= MOST_BYTES, "{bytes} bytes, above the limit of {MOST_BYTES}");
    parse(&std::fs::read_to_string(path)?)
}

fn parse(text: &str) -> anyhow::Result<Bsdf> {
    let document = Document::parse(text)?;
    let root = document.root_element();
    ensure!(
        root.tag_name().name() == "WindowElement",
        "<{}> is the root element, where a BSDF has <WindowElement>",
        root.tag_name().name()
    );
    let optical = child(root, "Optical")?;
    let layer = child(optical, "Layer")?;
    let definition = child(layer, "DataDefinition")?;
    let structure = text_of(child(definition, "IncidentDataStructure")?)?;
    let (block, direction) = transmission(layer)?;
    let data = child(block, "ScatteringData")?;
    let bsdf = match structure {
        "Columns" | "Rows" => matrix(definition, block, data, structure == "Rows"),
        "TensorTree3" => tensor::read(text_of(data)?, 3).with_context(|| name(data)),
        "TensorTree4" => tensor::read(text_of(data)?, 4).with_context(|| name(data)),
        other => bail!(
            "<IncidentDataStructure> is \"{other}\": Columns, Rows, TensorTree3 and TensorTree4 are read"
        ),
    }?;
    Ok(if direction == "Transmission Back" { bsdf.reciprocal() } else { bsdf })
}

/// The block of the light that passes, and its direction.
fn transmission<'a>(layer: Node<'a, 'a>) -> anyhow::Result<(Node<'a, 'a>, &'a str)> {
    let mut found: Option<((bool, bool), Node<'a, 'a>, &'a str)> = None;
    for data in children(layer, "WavelengthData") {
        let visible = child(data, "Wavelength").and_then(text_of).is_ok_and(|w| w == "Visible");
        for block in children(data, "WavelengthDataBlock") {
            let direction = text_of(child(block, "WavelengthDataDirection")?)?;
            let front = match direction {
                "Transmission Front" => true,
                "Transmission Back" => false,
                _ => continue,
            };
            // The first of the best.
            if found.is_none_or(|(best, ..)| (visible, front) > best) {
                found = Some(((visible, front), block, direction));
            }
        }
    }
    let (_, block, direction) = found.context(
        "no <WavelengthDataBlock> has a <WavelengthDataDirection> of Transmission Front or Back: nothing passes",
    )?;
    Ok((block, direction))
}

/// A matrix over Klems patches. In rows or columns of incident directions; always
/// turned so that incident patches vary fastest.
fn matrix(
    definition: Node<'_, '_>,
    block: Node<'_, '_>,
    data: Node<'_, '_>,
    rows: bool,
) -> anyhow::Result<Bsdf> {
    let [column, row] = ["ColumnAngleBasis", "RowAngleBasis"].map(|basis| {
        let named = child(block, basis)?;
        klems(definition, text_of(named)?).with_context(|| name(named))
    });
    let (column, row) = (column?, row?);
    let (columns, count) = (column.len(), column.len() * row.len());
    let values = text_of(data)?.split([',', ' ', '\t', '\r', '\n']).filter(|s| !s.is_empty());
    let mut table = Vec::with_capacity(count);
    for value in values {
        ensure!(table.len() < count, "<ScatteringData>: more than {count} values");
        let parsed = value.parse::<f32>();
        let at = table.len();
        table.push(parsed.with_context(|| format!("<ScatteringData>: value {at} is \"{value}\""))?);
    }
    ensure!(
        table.len() == count,
        "<ScatteringData>: {} values, where the angle bases need {count}",
        table.len()
    );
    let (incident, outgoing, values) = if rows {
        let turned = (0..count).map(|i| table[i % row.len() * columns + i / row.len()]).collect();
        (row, column, turned)
    } else {
        (column, row, table)
    };
    Bsdf::new(incident, outgoing, values).with_context(|| name(data))
}

/// The angle basis of that name, from the file.
fn klems(definition: Node<'_, '_>, wanted: &str) -> anyhow::Result<Patches> {
    let bases = children(definition, "AngleBasis");
    for basis in bases {
        if text_of(child(basis, "AngleBasisName")?)? != wanted {
            continue;
        }
        let mut rings: Vec<Ring> = Vec::new();
        for block in children(basis, "AngleBasisBlock") {
            let number = |node: Node<'_, '_>| -> anyhow::Result<f64> {
                let text = text_of(node)?;
                let value = text.parse::<f64>().ok().filter(|x| x.is_finite());
                value.with_context(|| format!("{} is \"{text}\", not a number", name(node)))
            };
            let bounds = child(block, "ThetaBounds")?;
            let lower = number(child(bounds, "LowerTheta")?)?;
            let upper = number(child(bounds, "UpperTheta")?)?;
            let patches = number(child(block, "nPhis")?)?;
            let last = rings.last().map_or(0.0, |ring| ring.theta.to_degrees());
            ensure!(
                (lower - last).abs() < 1e-3 && upper > lower && upper <= 90.0,
                "<ThetaBounds> from {lower} to {upper}, where {last} to at most 90 degrees must follow"
            );
            ensure!(
                (1.0..=1e4).contains(&patches) && patches.fract() == 0.0,
                "<nPhis> is {patches}"
            );
            rings.push(Ring { theta: upper.to_radians(), patches: patches as u32 });
        }
        let last = rings.last().context("<AngleBasis>: no <AngleBasisBlock>")?;
        ensure!(last.theta > 89.9_f64.to_radians(), "<AngleBasis> ends before 90 degrees");
        return Ok(Patches::Klems(rings));
    }
    bail!("no <AngleBasis> has the <AngleBasisName> \"{wanted}\"")
}

fn children<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |child| child.tag_name().name() == name)
}

fn child<'a>(node: Node<'a, 'a>, wanted: &'static str) -> anyhow::Result<Node<'a, 'a>> {
    children(node, wanted).next().with_context(|| format!("{} has no <{wanted}>", name(node)))
}

fn text_of<'a>(node: Node<'a, 'a>) -> anyhow::Result<&'a str> {
    let text = node.text().map(str::trim).filter(|text| !text.is_empty());
    text.with_context(|| format!("{} is empty", name(node)))
}

fn name(node: Node<'_, '_>) -> String {
    format!("<{}>", node.tag_name().name())
}

#[cfg(test)]
mod tests;
