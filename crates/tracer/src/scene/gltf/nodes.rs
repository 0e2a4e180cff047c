//! The node hierarchy: who is whose child, and where each node is.

use super::document::get;
use ::gltf::json::{Node, Root};
use anyhow::{Context as _, bail, ensure};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};

/// The nodes of the displayed scene.
#[derive(Debug)]
pub(super) struct Hierarchy {
    /// Indices of its nodes, parents first.
    pub(super) order: Vec<usize>,
    /// For each node of the file.
    pub(super) parent: Vec<Option<usize>>,
    /// Node to parent at rest, for each node of the file.
    pub(super) local: Vec<Placement>,
    /// Node to world at rest, for each node of the file.
    pub(super) world: Vec<DAffine3>,
}

/// Translation, rotation and scale of a node relative to its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Placement {
    Parts {
        translation: DVec3,
        rotation: DQuat,
        scale: DVec3,
    },
    /// As authored: a matrix may shear, which no parts can.
    Matrix(DAffine3),
}

impl Placement {
    pub(super) fn to_affine(self) -> DAffine3 {
        match self {
            Self::Parts { translation, rotation, scale } => {
                DAffine3::from_scale_rotation_translation(scale, rotation, translation)
            }
            Self::Matrix(matrix) => matrix,
        }
    }

    fn of(node: &Node) -> anyhow::Result<Self> {
        let placement = match &node.matrix {
            Some(columns) => {
                let matrix = DMat4::from_cols_array(&columns.map(f64::from));
                Self::Matrix(DAffine3::from_mat4(matrix))
            }
            None => {
                let [x, y, z, w] = node.rotation.unwrap_or_default().0;
                let rotation = quaternion([x, y, z, w]).context("its rotation is zero")?;
                let vector = |v: Option<[f32; 3]>, default: f32| {
                    DVec3::from(v.unwrap_or([default; 3]).map(f64::from))
                };
                let translation = vector(node.translation, 0.0);
                let scale = vector(node.scale, 1.0);
                Self::Parts { translation, rotation, scale }
            }
        };
        ensure!(placement.to_affine().is_finite(), "its transform is not finite");
        Ok(placement)
    }
}

/// A unit quaternion from glTF's x, y, z, w; exporters round theirs.
pub(super) fn quaternion(xyzw: [f32; 4]) -> Option<DQuat> {
    let q = DQuat::from_array(xyzw.map(f64::from));
    let length = q.length();
    (length.is_finite() && length > 1e-6).then(|| q / length)
}

impl Hierarchy {
    /// Reads the file's default scene, or its first, or else all of its nodes.
    ///
    /// # Errors
    ///
    /// If a node is its own ancestor, has two parents, or has no valid place.
    pub(super) fn read(root: &Root) -> anyhow::Result<Self> {
        let count = root.nodes.len();
        let mut parent = vec![None; count];
        for (i, node) in root.nodes.iter().enumerate() {
            for child in node.children.iter().flatten() {
                let slot = parent.get_mut(child.value());
                let slot = slot.with_context(|| {
                    format!("{} has a child {} that is not there", label(root, i), child.value())
                })?;
                ensure!(slot.is_none(), "{} has two parents", label(root, child.value()));
                *slot = Some(i);
            }
        }
        let local = root.nodes.iter().enumerate();
        let local = local.map(|(i, node)| Placement::of(node).with_context(|| label(root, i)));
        let local: Vec<Placement> = local.collect::<anyhow::Result<_>>()?;

        let scene = match root.scene {
            Some(index) => Some(get(root, index, "scene")?),
            None => root.scenes.first(),
        };
        let free = || (0..count).filter(|&i| parent[i].is_none());
        let shown: Vec<usize> = match scene {
            Some(scene) => scene.nodes.iter().map(|n| n.value()).collect(),
            None => free().collect(),
        };
        let mut reached = vec![false; count];
        for &i in &shown {
            ensure!(i < count, "the scene has a node {i} that is not there");
            ensure!(parent[i].is_none(), "{} is in the scene and another's child", label(root, i));
            let twice = std::mem::replace(&mut reached[i], true);
            ensure!(!twice, "{} is in the scene twice", label(root, i));
        }
        let hidden: Vec<usize> = free().filter(|&i| !reached[i]).collect();

        let mut world = vec![DAffine3::IDENTITY; count];
        let mut walk = |roots: Vec<usize>| {
            // A stack of our own: files can nest deeper than the thread's.
            let mut stack = roots;
            stack.reverse();
            let mut order = Vec::new();
            while let Some(i) = stack.pop() {
                order.push(i);
                reached[i] = true;
                let above = parent[i].map_or(DAffine3::IDENTITY, |p: usize| world[p]);
                world[i] = above * local[i].to_affine();
                let children = root.nodes[i].children.iter().flatten();
                stack.extend(children.rev().map(|c| c.value()));
            }
            order
        };
        let order = walk(shown);
        walk(hidden);
        // With one parent each, only a ring of nodes is out of the roots' reach.
        if let Some(i) = reached.iter().position(|&r| !r) {
            bail!("{} is its own ancestor, or the child of one that is", label(root, i));
        }
        Ok(Self { order, parent, local, world })
    }

    /// `node` and its ancestors, from the root down.
    pub(super) fn chain(&self, node: usize) -> Vec<usize> {
        let mut chain: Vec<usize> =
            std::iter::successors(Some(node), |&i| self.parent[i]).collect();
        chain.reverse();
        chain
    }
}

/// How messages call a node.
pub(super) fn label(root: &Root, node: usize) -> String {
    match root.nodes.get(node).and_then(|n| n.name.as_ref()) {
        Some(name) => format!("node {name:?}"),
        None => format!("node {node}"),
    }
}

/// `transform` without its scale: a rotation and a translation.
///
/// The z axis keeps its direction exactly, and y stays in the plane of both.
/// `None` if the transform flattens one of the two.
pub(super) fn rigid(transform: &DAffine3) -> Option<DAffine3> {
    let z = transform.matrix3.z_axis.try_normalize()?;
    let x = transform.matrix3.y_axis.cross(z).try_normalize()?;
    let axes = DMat3::from_cols(x, z.cross(x), z);
    Some(DAffine3::from_mat3_translation(axes, transform.translation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};
    use std::f64::consts::FRAC_1_SQRT_2;

    fn read(nodes: Value, scene: Value) -> anyhow::Result<Hierarchy> {
        let root = json!({"asset": {"version": "2.0"}, "nodes": nodes, "scenes": scene});
        Hierarchy::read(&serde_json::from_value(root).expect("glTF JSON"))
    }

    #[test]
    fn transforms_multiply_down_the_hierarchy() {
        // A quarter turn about y takes +x to −z.
        let turn = json!([0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2]);
        let hierarchy = read(
            json!([
                {"translation": [1, 0, 0], "children": [2]},
                {"name": "outside"},
                {"rotation": turn, "scale": [2, 2, 2], "children": [3]},
                {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]}
            ]),
            json!([{"nodes": [0]}]),
        )
        .expect("a tree");
        assert_eq!(hierarchy.order, [0, 2, 3]);
        assert_eq!(hierarchy.chain(3), [0, 2, 3]);
        let origin = hierarchy.world[3].translation;
        assert!(origin.abs_diff_eq(DVec3::new(1.0, 0.0, -6.0), 1e-6), "{origin}");
    }

    #[test]
    fn all_nodes_count_where_there_is_no_scene() {
        let nodes = json!([{"children": [1]}, {}, {}]);
        let hierarchy = read(nodes, json!([])).expect("two trees");
        assert_eq!(hierarchy.order, [0, 1, 2]);
    }

    #[test]
    fn graphs_that_are_no_trees_are_errors() {
        let scene = json!([{"nodes": [0]}]);
        for (nodes, expected) in [
            (json!([{}, {"children": [2]}, {"name": "b", "children": [1]}]), "its own ancestor"),
            (json!([{}, {"children": [1]}]), "node 1 is its own ancestor"),
            (json!([{"children": [1]}, {"children": [0]}]), "another's child"),
            (json!([{"children": [2]}, {"children": [2]}, {"name": "x"}]), "\"x\" has two parents"),
            (json!([{"children": [9]}]), "node 0 has a child 9 that is not there"),
            (json!([]), "the scene has a node 0 that is not there"),
            (json!([{"rotation": [0, 0, 0, 0]}]), "node 0: its rotation is zero"),
            (json!([{"translation": [1e300, 0, 0]}]), "node 0: its transform is not finite"),
        ] {
            let text = format!("{:#}", read(nodes, scene.clone()).expect_err("not a tree"));
            assert!(text.contains(expected), "{text}");
        }
        assert!(read(json!([{}]), json!([{"nodes": [0, 0]}])).is_err(), "listed twice");
    }

    #[test]
    fn deep_hierarchies_do_not_overflow_the_stack() {
        let mut nodes: Vec<Value> =
            (1..100_000).map(|i| json!({"children": [i], "translation": [1, 0, 0]})).collect();
        nodes.push(json!({}));
        let hierarchy = read(Value::from(nodes), json!([{"nodes": [0]}])).expect("a long chain");
        assert_eq!(hierarchy.world[99_999].translation.x, 99_999.0);
    }

    #[test]
    fn rigid_parts_have_no_scale() {
        let turn = DQuat::from_rotation_y(0.3);
        let at = DVec3::new(1.0, 2.0, 3.0);
        let scaled = DAffine3::from_scale_rotation_translation(DVec3::new(2.0, 3.0, 5.0), turn, at);
        let rigid_part = rigid(&scaled).expect("nothing is flattened");
        assert!(rigid_part.abs_diff_eq(DAffine3::from_rotation_translation(turn, at), 1e-12));
        assert!(rigid(&DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0))).is_none(), "no z");
    }
}
