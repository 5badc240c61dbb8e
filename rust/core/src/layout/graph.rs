//! What tracing gives: nodes, and the traces between them.

/// What a node of the graph is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NodeKind {
    /// A vertex of the mesh, where traces start.
    Vertex(usize),
    /// The end of a trace on another one, on whose left it lies or not.
    Junction {
        /// Whether the trace that ends comes from the left of the other.
        from_left: bool,
    },
    /// The end of a trace on the outline, at a fraction of the edge after a vertex.
    Hit {
        /// Where the edge starts.
        vertex: usize,
        /// How far along it.
        fraction: f64,
    },
    /// Where two traces meet on one line.
    Join,
}

/// A node and its place in the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// What it is.
    pub kind: NodeKind,
    /// Where it is.
    pub point: [f64; 2],
}

/// A node on a trace, at a length in the map from the trace's start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// The length.
    pub length: f64,
    /// The node.
    pub node: usize,
}

/// A trace from node to node.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Node where it starts.
    pub origin: usize,
    /// Nodes along it, the last one its end.
    pub stops: Vec<Stop>,
    /// Lengths and points where it leaves one triangle after the other.
    pub crossings: Vec<(f64, [f64; 2])>,
}

/// Nodes and traces; the traces of a vertex follow each other counter-clockwise.
#[derive(Debug, Clone, PartialEq)]
pub struct MotorcycleGraph {
    /// All nodes.
    pub nodes: Vec<Node>,
    /// All traces.
    pub traces: Vec<Trace>,
}
