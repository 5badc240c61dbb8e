//! What happens to traces, in the order of time.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// What happens.
#[derive(Debug, Clone, Copy)]
pub enum Event {
    /// A trace leaves a triangle.
    Advance(usize),
    /// Two chords cross, each at its time.
    Crossing([usize; 2], [f64; 2]),
    /// Two traces meet head-on.
    Meeting([usize; 2], f64),
    /// A trace is at the outline.
    Arrival(usize),
}

/// An event with its place in the queue.
#[derive(Debug, Clone, Copy)]
struct Scheduled {
    time: f64,
    serial: usize,
    event: Event,
}

impl Ord for Scheduled {
    fn cmp(&self, other: &Self) -> Ordering {
        self.time.total_cmp(&other.time).then(self.serial.cmp(&other.serial))
    }
}

impl PartialOrd for Scheduled {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Scheduled {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Scheduled {}

/// Delay of a meeting, in instants: a crossing may be an instant from it and is decided another one later.
const MEETING: f64 = 4.0;

/// Events to come.
#[derive(Debug)]
pub struct Schedule {
    queue: BinaryHeap<Reverse<Scheduled>>,
    serial: usize,
    /// Times closer than this are one.
    pub instant: f64,
}

impl Schedule {
    /// No events yet.
    pub fn new(instant: f64) -> Self {
        Self { queue: BinaryHeap::new(), serial: 0, instant }
    }

    /// Add an event. Of those at one time moves come first, so that all is known that the others depend on; then what
    /// stops one trace before what stops two, and the outline last.
    pub fn push(&mut self, time: f64, event: Event) {
        let delay = match event {
            Event::Advance(_) => 0.0,
            Event::Crossing(..) => 1.0,
            Event::Meeting(..) => MEETING,
            Event::Arrival(_) => 6.0,
        };
        self.insert(time + delay * self.instant, event);
    }

    /// Add an event that waits for a meeting.
    pub fn postpone(&mut self, meeting: f64, event: Event) {
        self.insert(meeting + (MEETING + 1.0) * self.instant, event);
    }

    fn insert(&mut self, time: f64, event: Event) {
        self.serial += 1;
        self.queue.push(Reverse(Scheduled { time, serial: self.serial, event }));
    }

    /// The next event and when it is decided.
    pub fn pop(&mut self) -> Option<(f64, Event)> {
        self.queue.pop().map(|Reverse(next)| (next.time, next.event))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_come_by_time_then_kind_then_order() {
        let mut schedule = Schedule::new(0.25);
        schedule.push(1.0, Event::Arrival(0));
        schedule.push(1.0, Event::Meeting([0, 1], 1.0));
        schedule.push(1.0, Event::Crossing([0, 1], [0.5, 1.0]));
        schedule.push(9.0, Event::Advance(7));
        schedule.push(1.0, Event::Advance(2));
        schedule.push(1.0, Event::Advance(1));
        let names: Vec<String> =
            std::iter::from_fn(|| schedule.pop()).map(|(time, event)| format!("{time} {event:?}")).collect();
        let wanted = [
            "1 Advance(2)",
            "1 Advance(1)",
            "1.25 Crossing([0, 1], [0.5, 1.0])",
            "2 Meeting([0, 1], 1.0)",
            "2.5 Arrival(0)",
            "9 Advance(7)",
        ];
        assert_eq!(names, wanted);
    }
}
