// Commands, for a page that was opened with a token. Each is confirmed before it is sent.
import { of, element } from "./tables.js";

export const offer = about => {
  const token = location.hash.slice(1);
  if (!about.commands || !token || !about.consoles.length) return;
  of("commands").hidden = false;
  const verbs = about.consoles.flatMap(console => about.verbs.map(verb => `${console}.${verb}`));
  of("verb").replaceChildren(...verbs.map(verb => element("option", verb)));
  const values = () => of("values").value.trim().split(/\s+/).filter(value => value);
  of("command").addEventListener("submit", event => {
    event.preventDefault();
    of("question").textContent = `Send ${of("verb").value} ${values().join(" ")} to ${about.pipeline}?`;
    of("sure").showModal();
  });
  of("no").addEventListener("click", () => of("sure").close());
  of("yes").addEventListener("click", async () => {
    of("sure").close();
    of("answer").textContent = "sent, waiting for the answer";
    of("answer").className = "";
    try {
      const body = JSON.stringify({ command: of("verb").value, values: values() });
      const response = await fetch("command", { method: "POST", headers: { "X-Token": token }, body });
      const text = await response.text();
      const answer = response.ok ? JSON.parse(text) : { taken: false, text };
      of("answer").textContent = answer.text;
      of("answer").className = answer.taken ? "good" : "bad";
    } catch (error) {
      of("answer").textContent = `no answer: ${error.message}`;
      of("answer").className = "bad";
    }
  });
};
