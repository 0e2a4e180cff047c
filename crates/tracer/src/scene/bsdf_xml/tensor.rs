//! Tensor trees: braces that hold 2^rank branches, or values on a grid.

use anyhow::{Context as _, bail, ensure};
use glam::DVec2;
use wrt_core::{Bsdf, Patches, disc_of_square};

/// The finest level read: 64² incident × 64² outgoing directions.
const MAX_LEVEL: u8 = 6;

/// A tree over the unit hypercube. Dimension 0 varies slowest on a grid, and has bit 0 of
/// a branch's number.
#[derive(Debug)]
enum Tree {
    Branches(Vec<Self>),
    /// 2^(rank · level) values.
    Values(u8, Vec<f32>),
}

/// Reads `text` and tabulates it over the cells of its finest level. A tree of `rank` 3
/// is isotropic: its incident direction has a radius alone.
pub(super) fn read(text: &str, rank: usize) -> anyhow::Result<Bsdf> {
    let mut words = Words { rest: text };
    let tree = Tree::parse(&mut words, rank, 0)?;
    let after = words.next();
    ensure!(after.is_none(), "\"{}\" after the end of the tree", after.unwrap_or_default());
    let level = tree.depth().max(1);
    let side = 1_usize << level;
    let centre = |i: usize| {
        let at = |m: usize| (m as f64 + 0.5) / side as f64;
        DVec2::new(at(i / side), at(i % side))
    };
    // Straight through, light runs along an edge between a rank 3 tree's cells: those of
    // the table get means, of a quarter of a million look-ups a row at most.
    let parts = if rank == 4 { 1 } else { (64 >> level).clamp(2, 8) };
    let within = |i: usize, part: usize| {
        let at = |m: usize, p: usize| (m as f64 + (p as f64 + 0.5) / parts as f64) / side as f64;
        DVec2::new(at(i / side, part / parts), at(i % side, part % parts))
    };
    let values = (0..side * side).flat_map(|leave| {
        let tree = &tree;
        (0..side * side).map(move |travel| {
            let travel = centre(travel);
            if rank == 4 {
                let leave = centre(leave);
                return tree.value(&mut [travel.x, travel.y, leave.x, leave.y]);
            }
            let value =
                |part| isotropic(tree, disc_of_square(travel), disc_of_square(within(leave, part)));
            (0..parts * parts).map(value).sum::<f32>() / (parts * parts) as f32
        })
    });
    Ok(Bsdf::new(Patches::Square(level), Patches::Square(level), values.collect())?)
}

/// The value of a tree of rank 3: the incident direction turned to the −x axis, whose
/// square's coordinate is ½ − ½ its radius; the other turned with it.
fn isotropic(tree: &Tree, incident: DVec2, other: DVec2) -> f32 {
    let radius = incident.length();
    let turned = if radius > 0.0 {
        let axis = -incident / radius;
        DVec2::new(axis.dot(other), axis.perp_dot(other))
    } else {
        other
    };
    let square = wrt_core::square_of_disc(turned);
    tree.value(&mut [(0.5 - 0.5 * radius).max(0.0), square.x, square.y])
}

impl Tree {
    fn parse(words: &mut Words<'_>, rank: usize, depth: u8) -> anyhow::Result<Self> {
        ensure!(depth <= MAX_LEVEL, "a tree of more than {MAX_LEVEL} levels");
        match words.next() {
            Some("{") => {}
            Some(other) => bail!("\"{other}\", where a \"{{\" must be"),
            None => bail!("it ends early"),
        }
        let mut branches = Vec::new();
        let mut values: Vec<f32> = Vec::new();
        loop {
            match words.peek() {
                None => bail!("it ends early"),
                Some("}") => {
                    words.next();
                    break;
                }
                Some("{") => {
                    ensure!(values.is_empty(), "values and branches side by side");
                    branches.push(Self::parse(words, rank, depth + 1)?);
                    ensure!(branches.len() <= 1 << rank, "more than {} branches", 1 << rank);
                }
                Some(word) => {
                    ensure!(branches.is_empty(), "\"{word}\" beside branches");
                    let value = word.parse::<f32>().ok().filter(|v| v.is_finite());
                    values.push(value.with_context(|| format!("\"{word}\" is no number"))?);
                    ensure!(
                        values.len() <= 1 << (rank * usize::from(MAX_LEVEL - depth)),
                        "a tree of more than {MAX_LEVEL} levels"
                    );
                    words.next();
                }
            }
        }
        if branches.is_empty() {
            let level = (0..=MAX_LEVEL).find(|&l| 1 << (rank * usize::from(l)) == values.len());
            let count = values.len();
            let level = level.with_context(|| {
                format!("{count} values between braces, no power of {}", 1 << rank)
            })?;
            return Ok(Self::Values(level, values));
        }
        ensure!(branches.len() == 1 << rank, "{} of {} branches", branches.len(), 1 << rank);
        Ok(Self::Branches(branches))
    }

    fn depth(&self) -> u8 {
        match self {
            Self::Branches(branches) => 1 + branches.iter().map(Self::depth).max().unwrap_or(0),
            Self::Values(level, _) => *level,
        }
    }

    /// The value at a point of the unit hypercube.
    fn value(&self, at: &mut [f64]) -> f32 {
        match self {
            Self::Branches(branches) => {
                let mut branch = 0;
                for (d, x) in at.iter_mut().enumerate() {
                    *x *= 2.0;
                    if *x >= 1.0 {
                        branch |= 1 << d;
                        *x -= 1.0;
                    }
                }
                branches[branch].value(at)
            }
            Self::Values(level, values) => {
                let side = 1_usize << level;
                let index = at
                    .iter()
                    .fold(0, |index, x| index * side + ((x * side as f64) as usize).min(side - 1));
                values[index]
            }
        }
    }
}

/// Braces and numbers between blanks and commas.
struct Words<'a> {
    rest: &'a str,
}

impl<'a> Words<'a> {
    fn split(&self) -> Option<(&'a str, &'a str)> {
        let rest = self.rest.trim_start_matches([' ', ',', '\t', '\r', '\n']);
        let end = match rest.chars().next()? {
            '{' | '}' => 1,
            _ => rest.find([' ', ',', '\t', '\r', '\n', '{', '}']).unwrap_or(rest.len()),
        };
        Some(rest.split_at(end))
    }

    fn peek(&self) -> Option<&'a str> {
        self.split().map(|(word, _)| word)
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        let (word, rest) = self.split()?;
        self.rest = rest;
        Some(word)
    }
}
