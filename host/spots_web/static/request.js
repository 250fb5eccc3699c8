// Requests of this window to the server, which accepts them only with the token.

// Sends a POST and returns the answer: its JSON object, {} if the answer has no body, or {refused: why}
// after an error. If the server does not answer, the result also has `unanswered: true`.
export async function request(path, body) {
  try {
    const answer = await fetch(path, { method: "POST", body: typeof body === "string" ? body : JSON.stringify(body) });
    if (!answer.ok) return { refused: await answer.text() };
    return answer.status === 204 ? {} : await answer.json();
  } catch {
    return { refused: "the server does not answer: try again", unanswered: true };
  }
}
