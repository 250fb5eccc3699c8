// Requests of the panels: this page has no server, so those of a server are refused.
import { ask } from "./link.js";

export function request(path, body) {
  return ask(path, body);
}
