// Requests of this window to the server; only those with the token are accepted.

// Returns the answer of a POST: its JSON object, {} without one, or {refused: why}.
// Without any answer, it is also `unanswered`.
export async function request(path, body) {
  try {
    const answer = await fetch(path, { method: "POST", body: typeof body === "string" ? body : JSON.stringify(body) });
    if (!answer.ok) return { refused: await answer.text() };
    return answer.status === 204 ? {} : await answer.json();
  } catch {
    return { refused: "the server does not answer: try again", unanswered: true };
  }
}
