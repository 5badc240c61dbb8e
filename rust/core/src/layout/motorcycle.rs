//! Motorcycle graph of a seamless map (Eppstein et al. 2008): traces leave the singularities and corners along the
//! axes of the map, all at one speed, and end where another one has passed, or on the outline.
//!
//! # Decisions
//! Points that lie on one line are the rule in engineering outlines, so nothing is decided by intersecting lines.
//! A trace is a strip of triangles: on every edge that it crosses one vertex is on its left, one on its right. These two are
//! carried into the next triangle, and only the side of that triangle's third vertex is decided, by its coordinate.
//!
//! **Rule:** a vertex on the line of a trace, to within a tolerance, lies on the trace's right; that is, every
//! trace is moved to its own left by an infinitesimal amount. "Left" turns with the direction by quarter turns and
//! does not change with translations, so that the rule is the same on both sides of every seam.
//!
//! Whether two traces cross in a triangle follows from the cyclic order of their ends on its three sides; traces
//! through one edge are ordered once for both its triangles, at equal places by who came first. So two traces that must
//! cross do so in exactly one triangle, whatever the rounding.
//!
//! **Head-on:** two traces that come along one line from opposite ends both end where they meet, half-way in time. A
//! trace that runs into a singularity or corner always meets the trace that it sends back, so no traces of one
//! direction coincide. The perturbation sends the two around opposite sides of the vertices on their line; hence the
//! meeting is recognised where both cross one triangle, or run along one edge.
//!
//! **Time:** a crossing is decided when the later of the two gets there, by length in the map. Of two that come at the
//! same time the one from the right goes first, unless one is about to meet its opposite right there: such a pair goes
//! first, and what is decided about one of the two holds for the other, or a trace could end beyond the end of the one
//! that stops it. A crossing beyond a meeting waits for that. Events at one time are sorted by kind, see `schedule`.
//!
//! Folded triangles have a strip as others have, so a trace passes them; it may then be too long, which is an error.
//! What lies across a side of a triangle is asked in one place, [`Tracer::advance`]: walls inside the domain belong there.

use std::collections::BTreeMap;

use super::adjacency::Place;
use super::charts::{ChartError, Charts, forward, leftward};
use super::chord::{Chord, Entry, Gate, Rim, between};
use super::graph::{MotorcycleGraph, Node, NodeKind, Stop, Trace};
use super::schedule::{Event, Schedule};
use thiserror::Error;

/// Why there is no motorcycle graph.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TraceError {
    /// The map's charts do not fit the indices.
    #[error(transparent)]
    Chart(#[from] ChartError),
    /// A trace crosses more triangles than any sensible one.
    #[error("the trace from vertex {vertex} at {point:?} does not end within {steps} triangles")]
    Endless {
        /// Where it starts.
        vertex: usize,
        /// The place of that vertex.
        point: [f64; 2],
        /// Number of triangles crossed.
        steps: usize,
    },
}

/// Trace the graph. Every loop of the outline gets a node, if need be by a trace of its own.
pub fn trace(charts: &Charts<'_>) -> Result<MotorcycleGraph, TraceError> {
    let mut tracer = Tracer::new(charts);
    for vertex in (0..charts.mesh.points.len()).filter(|&v| charts.is_critical(v)) {
        tracer.launch(vertex)?;
    }
    tracer.run()?;
    for index in charts.loops_by_length() {
        if !tracer.touches(index) {
            tracer.launch(charts.remotest(index))?;
            tracer.run()?;
        }
    }
    Ok(tracer.finish())
}

/// A trace while it runs.
#[derive(Debug, Clone)]
struct Rider {
    origin: usize,
    vertex: usize,
    started: f64,
    chords: Vec<usize>,
    end: Option<End>,
    /// Junctions on it: number of triangles before, time, node.
    junctions: Vec<(usize, f64, usize)>,
    /// When it will meet another one head-on, and which.
    meeting: Option<(f64, usize)>,
}

/// Who comes to a crossing.
#[derive(Debug, Clone, Copy)]
struct Comer {
    time: f64,
    name: usize,
    is_pair: bool,
}

/// The end of a trace: when, after how many triangles, in which node.
#[derive(Debug, Clone, Copy)]
struct End {
    time: f64,
    step: usize,
    node: usize,
    is_join: bool,
}

struct Tracer<'a> {
    charts: &'a Charts<'a>,
    nodes: Vec<Node>,
    riders: Vec<Rider>,
    chords: Vec<Chord>,
    latest: Vec<Option<usize>>,
    along: BTreeMap<usize, Vec<Along>>,
    /// Of two that came to one place, whether the second one was later.
    verdicts: BTreeMap<[usize; 2], bool>,
    schedule: Schedule,
    clock: f64,
    most_steps: usize,
}

/// A trace along an edge of the mesh: the vertex it comes from, and when it is there.
#[derive(Debug, Clone, Copy)]
struct Along {
    trace: usize,
    from: usize,
    time: f64,
    /// Of the edge's ends to its left.
    offsets: [f64; 2],
}

impl<'a> Tracer<'a> {
    fn new(charts: &'a Charts<'a>) -> Self {
        let m = charts.mesh.triangles.len();
        Self {
            charts,
            nodes: Vec::new(),
            riders: Vec::new(),
            chords: Vec::new(),
            latest: vec![None; m],
            along: BTreeMap::new(),
            verdicts: BTreeMap::new(),
            schedule: Schedule::new(charts.tolerance),
            clock: 0.0,
            // A trace may wind around a hole several times, but crosses no triangle more often than this.
            most_steps: 6 * m,
        }
    }

    /// Whether a loop of the outline has a node.
    fn touches(&self, index: usize) -> bool {
        let loops = self.charts.mesh.loops;
        self.nodes.iter().any(|node| match node.kind {
            NodeKind::Vertex(v) | NodeKind::Hit { vertex: v, .. } => loops.get(v) == Some(&index),
            _ => false,
        })
    }

    /// A node at a vertex and its traces, which start now.
    fn launch(&mut self, vertex: usize) -> Result<(), TraceError> {
        let origin = self.nodes.len();
        let point = self.charts.mesh.points[vertex];
        self.nodes.push(Node { kind: NodeKind::Vertex(vertex), point });
        for (corner, direction) in self.charts.launches(vertex)? {
            let trace = self.riders.len();
            let started = self.clock;
            self.riders.push(Rider {
                origin,
                vertex,
                started,
                chords: Vec::new(),
                end: None,
                junctions: Vec::new(),
                meeting: None,
            });
            let uv = self.charts.uv(corner);
            let entry = Entry {
                face: corner.face,
                direction,
                line: leftward(direction, uv),
                forward: forward(direction, uv),
                time: started,
                point,
                rim: (2 * corner.index, 0.0, 0),
            };
            self.lay(trace, entry, corner.index);
        }
        Ok(())
    }

    fn run(&mut self) -> Result<(), TraceError> {
        while let Some((time, event)) = self.schedule.pop() {
            self.clock = self.clock.max(time);
            match event {
                Event::Advance(trace) if self.riders[trace].end.is_none() => self.advance(trace)?,
                Event::Crossing(chords, times) => self.cross(chords, times),
                Event::Meeting([a, b], time) => self.meet(a, b, time),
                Event::Arrival(trace) if self.riders[trace].end.is_none() => self.arrive(trace),
                Event::Advance(_) | Event::Arrival(_) => {}
            }
        }
        Ok(())
    }

    fn last_chord(&self, trace: usize) -> Chord {
        let rider = &self.riders[trace];
        self.chords[rider.chords[rider.chords.len() - 1]]
    }

    /// Into the triangle across the last chord's exit.
    fn advance(&mut self, trace: usize) -> Result<(), TraceError> {
        let chord = self.last_chord(trace);
        let (face, here) = (chord.entry.face, chord.entry.direction);
        let Some(to) = self.charts.adjacency.neighbours[face][chord.exit] else {
            self.schedule.push(chord.time, Event::Arrival(trace));
            return Ok(());
        };
        if self.riders[trace].chords.len() >= self.most_steps {
            let vertex = self.riders[trace].vertex;
            let point = self.charts.mesh.points[vertex];
            return Err(TraceError::Endless { vertex, point, steps: self.most_steps });
        }
        let uv = |face: usize, index: usize| self.charts.uv(Place { face, index: index % 3 });
        let direction = (here + self.charts.mesh.rotation[face][chord.exit]) % 4;
        // The offsets from the edge's vertices are the same on both sides; the nearer vertex rounds less.
        let left = (uv(face, chord.exit + 2), uv(to.face, to.index + 1));
        let right = (uv(face, chord.exit + 1), uv(to.face, to.index + 2));
        let offset = |p: [f64; 2]| leftward(here, p) - chord.entry.line;
        let (p, q) = if offset(right.0).abs() < offset(left.0).abs() { right } else { left };
        let line = leftward(direction, q) - offset(p);
        // The exit joins the third vertex with that of the other side; a vertex on the line is on the right.
        let is_left = leftward(direction, uv(to.face, to.index)) - line > self.charts.touch;
        let exit = (to.index + if is_left { 1 } else { 2 }) % 3;
        let entry = Entry {
            face: to.face,
            direction,
            line,
            forward: forward(direction, q) - (forward(here, p) - chord.forward),
            time: chord.time,
            point: chord.gate.point,
            rim: self.rim(to, &chord.gate),
        };
        self.lay(trace, entry, exit);
        Ok(())
    }

    /// The place of a gate on the rim of a triangle.
    fn rim(&self, side: Place, gate: &Gate) -> Rim {
        let ends = self.ends(side);
        let slot = (2 * side.index + 3) % 6;
        if ends[0] < ends[1] {
            (slot, gate.fraction, gate.serial)
        } else {
            (slot, -gate.fraction, -gate.serial)
        }
    }

    /// Vertices of a side, counter-clockwise.
    fn ends(&self, side: Place) -> [usize; 2] {
        [1, 2].map(|i| self.charts.vertex(Place { face: side.face, index: (side.index + i) % 3 }))
    }

    /// Lay the chord of a trace from its entry to a side, and find what it meets there.
    fn lay(&mut self, trace: usize, entry: Entry, exit: usize) {
        let uv = self.charts.mesh.uv[entry.face];
        let offsets = uv.map(|p| leftward(entry.direction, p) - entry.line);
        let (right, left) = ((exit + 1) % 3, (exit + 2) % 3);
        let share = (-offsets[right] / (offsets[left] - offsets[right])).clamp(0.0, 1.0);
        let share = if share.is_nan() { 0.5 } else { share };
        let side = Place { face: entry.face, index: exit };
        let [a, b] = self.ends(side);
        let points = self.charts.mesh.points;
        let id = self.chords.len();
        let gate = Gate {
            fraction: if a < b { share } else { 1.0 - share },
            serial: id as i64,
            point: between(points[a], points[b], share),
        };
        let to = forward(entry.direction, between(uv[right], uv[left], share));
        let chord = Chord {
            trace,
            step: self.riders[trace].chords.len(),
            entry,
            exit,
            forward: to,
            time: entry.time + (to - entry.forward).abs(),
            rim: self.rim(side, &gate),
            gate,
            before: self.latest[entry.face],
        };
        let mut other = chord.before;
        while let Some(i) = other {
            self.compare(id, &chord, i);
            other = self.chords[i].before;
        }
        self.run_along(&chord, offsets);
        self.chords.push(chord);
        self.latest[entry.face] = Some(id);
        self.riders[trace].chords.push(id);
        self.schedule.push(chord.time, Event::Advance(trace));
    }

    /// Crossings and meetings of a new chord with one laid before in the same triangle.
    fn compare(&mut self, id: usize, chord: &Chord, other_id: usize) {
        let other = self.chords[other_id];
        let (here, there) = (&chord.entry, &other.entry);
        if (here.direction + there.direction) % 2 == 1 {
            if chord.crossed_from_left(&other).is_some() {
                let times = [chord.time_on(&other), other.time_on(chord)];
                self.schedule.push(times[0].max(times[1]), Event::Crossing([id, other_id], times));
            }
        } else if here.direction != there.direction && (here.line + there.line).abs() <= self.charts.tolerance
        {
            let gap = -there.forward - here.forward;
            self.plan_meeting([chord.trace, other.trace], [here.time, there.time], gap);
        }
    }

    /// Two traces on one line: where they are at which times, and the distance between.
    fn plan_meeting(&mut self, [a, b]: [usize; 2], times: [f64; 2], gap: f64) {
        if a == b
            || gap < -self.charts.tolerance
            || self.riders[a].end.is_some()
            || self.riders[b].end.is_some()
        {
            return;
        }
        let time = (times[0] + times[1] + gap) / 2.0;
        if time < self.clock - self.charts.tolerance {
            return;
        }
        for (trace, partner) in [(a, b), (b, a)] {
            let known = self.riders[trace].meeting;
            if known.is_none_or(|(t, p)| time < t || self.riders[p].end.is_some()) {
                self.riders[trace].meeting = Some((time, partner));
            }
        }
        self.schedule.push(time, Event::Meeting([a, b], time));
    }

    /// Find traces that come along the same edges of the mesh the other way, perhaps on their other side.
    fn run_along(&mut self, chord: &Chord, offsets: [f64; 3]) {
        let (face, direction) = (chord.entry.face, chord.entry.direction);
        // A trace on the same line may have its vertices that far from this one.
        let on = |i: usize| offsets[i].abs() <= self.charts.tolerance + self.charts.touch;
        for side in (0..3).filter(|i| on((i + 1) % 3) && on((i + 2) % 3)) {
            let mut ends = [1, 2].map(|i| {
                let corner = Place { face, index: (side + i) % 3 };
                (
                    forward(direction, self.charts.uv(corner)),
                    self.charts.vertex(corner),
                    offsets[corner.index],
                )
            });
            ends.sort_by(|a, b| a.0.total_cmp(&b.0));
            let me = Along {
                trace: chord.trace,
                from: ends[0].1,
                time: chord.entry.time + ends[0].0 - chord.entry.forward,
                offsets: [ends[0].2, ends[1].2],
            };
            let list = self.along.entry(self.charts.adjacency.face_edges[face][side]).or_default();
            let apart = |o: &Along| (me.offsets[0] + o.offsets[1]).abs();
            let opposite: Vec<Along> = list
                .iter()
                .filter(|o| o.from != me.from && apart(o) <= self.charts.tolerance)
                .copied()
                .collect();
            list.push(me);
            for other in opposite {
                self.plan_meeting([me.trace, other.trace], [me.time, other.time], ends[1].0 - ends[0].0);
            }
        }
    }

    /// Whether a trace got as far as a time in a triangle.
    fn reached(&self, trace: usize, step: usize, time: f64) -> bool {
        self.riders[trace].end.is_none_or(|end| {
            // Another trace through the very place of a join must hit one of the two.
            if end.is_join {
                time <= end.time + self.charts.tolerance
            } else {
                (step, time) <= (end.step, end.time)
            }
        })
    }

    /// When a trace meets another one before it gets to a time, if both are on their way.
    fn meeting_before(&self, trace: usize, time: f64) -> Option<f64> {
        let (meeting, partner) = self.riders[trace].meeting?;
        let on_the_way = self.riders[trace].end.is_none() && self.riders[partner].end.is_none();
        (on_the_way && time > meeting + self.charts.tolerance).then_some(meeting)
    }

    /// Who comes to a crossing, and when: a trace, or two that meet head-on in the very place, by the smaller number.
    fn comer(&self, chord: &Chord, time: f64) -> Comer {
        match self.riders[chord.trace].meeting {
            Some((meeting, partner)) if (meeting - time).abs() <= self.charts.tolerance => {
                let broken = self.riders[partner].end.is_some_and(|end| !end.is_join);
                Comer { time: meeting, name: chord.trace.min(partner), is_pair: !broken }
            }
            _ => Comer { time, name: chord.trace, is_pair: false },
        }
    }

    /// Of two chords that cross, the trace that comes later ends there.
    fn cross(&mut self, ids: [usize; 2], times: [f64; 2]) {
        let chords = ids.map(|i| self.chords[i]);
        if (0..2).any(|i| !self.reached(chords[i].trace, chords[i].step, times[i])) {
            return;
        }
        // Where a trace comes only if its meeting does not take place is decided after that.
        let pending = (0..2).filter_map(|i| self.meeting_before(chords[i].trace, times[i]));
        if let Some(meeting) = pending.reduce(f64::max) {
            self.schedule.postpone(meeting, Event::Crossing(ids, times));
            return;
        }
        let [a, b] = [0, 1].map(|i| self.comer(&chords[i], times[i]));
        let known = self.verdicts.get(&[a.name, b.name]).copied();
        let second_later = known.unwrap_or_else(|| {
            if (a.time - b.time).abs() > self.charts.instant {
                return b.time > a.time;
            }
            match (a.is_pair, b.is_pair) {
                (false, false) => chords[1].crossed_from_left(&chords[0]) == Some(false),
                (true, true) => a.name < b.name,
                (first, _) => first,
            }
        });
        // The same for the other trace of a pair.
        if a.is_pair || b.is_pair {
            self.verdicts.insert([a.name, b.name], second_later);
            self.verdicts.insert([b.name, a.name], !second_later);
        }
        let (late, early) = if second_later { (1, 0) } else { (0, 1) };
        let (loser, winner) = (chords[late], chords[early]);
        if self.riders[loser.trace].end.is_some() {
            return;
        }
        let from_left = winner.crossed_from_left(&loser) == Some(true);
        let node = self.nodes.len();
        let point = winner.point_at(times[early]);
        self.nodes.push(Node { kind: NodeKind::Junction { from_left }, point });
        self.riders[winner.trace].junctions.push((winner.step, times[early], node));
        self.riders[loser.trace].end =
            Some(End { time: times[late], step: loser.step, node, is_join: false });
    }

    /// Two traces end where they meet, if nothing has stopped one before.
    fn meet(&mut self, a: usize, b: usize, time: f64) {
        if self.riders[a].end.is_some() || self.riders[b].end.is_some() {
            return;
        }
        let chords = &self.riders[a].chords;
        let step = chords.partition_point(|&c| self.chords[c].entry.time < time).saturating_sub(1);
        let point = self.chords[chords[step]].point_at(time);
        let node = self.nodes.len();
        self.nodes.push(Node { kind: NodeKind::Join, point });
        for trace in [a, b] {
            self.riders[trace].end = Some(End { time, step: usize::MAX, node, is_join: true });
        }
    }

    /// A trace ends on the outline.
    fn arrive(&mut self, trace: usize) {
        let chord = self.last_chord(trace);
        let [a, b] = self.ends(Place { face: chord.entry.face, index: chord.exit });
        let fraction = if a < b { chord.gate.fraction } else { 1.0 - chord.gate.fraction };
        let node = self.nodes.len();
        self.nodes.push(Node { kind: NodeKind::Hit { vertex: a, fraction }, point: chord.gate.point });
        self.riders[trace].end = Some(End { time: chord.time, step: chord.step, node, is_join: false });
    }

    fn finish(self) -> MotorcycleGraph {
        let traces = self.riders.into_iter().map(|mut rider| {
            // Triangle by triangle: rounding must not swap what lies in different ones.
            rider.junctions.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let end = rider.end.expect("events are left only when every trace has ended");
            let mut stops: Vec<Stop> = Vec::with_capacity(rider.junctions.len() + 1);
            for (time, node) in rider.junctions.into_iter().map(|j| (j.1, j.2)).chain([(end.time, end.node)])
            {
                let before = stops.last().map_or(0.0, |s| s.length);
                stops.push(Stop { length: (time.min(end.time) - rider.started).max(before), node });
            }
            let crossings = rider.chords.iter().map(|&c| {
                let chord = &self.chords[c];
                (chord.time - rider.started, chord.gate.point)
            });
            Trace { origin: rider.origin, stops, crossings: crossings.collect() }
        });
        MotorcycleGraph { nodes: self.nodes, traces: traces.collect() }
    }
}

#[cfg(test)]
#[path = "motorcycle_tests.rs"]
mod tests;
