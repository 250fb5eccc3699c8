// fifo.py for the live page: 128 values of two bytes each.

const ENTRIES = 128;

export class Fifo {
  entries = [];  // [low, high], the oldest first

  // Appends entries; a full FIFO drops the new one. Returns whether one was lost.
  push(entries) {
    const room = ENTRIES - this.entries.length;
    this.entries.push(...entries.slice(0, room));
    return entries.length > room;
  }

  // Returns the first byte of the oldest entry, which stays; 0 if the FIFO is empty.
  low() {
    return this.entries[0]?.[0] ?? 0;
  }

  // Removes the oldest entry, and returns its second byte; 0 if the FIFO is empty.
  high() {
    return this.entries.shift()?.[1] ?? 0;
  }
}
