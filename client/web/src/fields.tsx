// Inputs with their unit, range, default and fault; and the forms of an initial condition made of them.
import { type FieldSpec, type Form, type Texts, chaserTexts, forms } from "./form";
import type { Scenario } from "./types";

export interface FieldProps {
  path: string;
  spec: Pick<FieldSpec, "label" | "unit" | "range" | "choices">;
  text: string;
  standard?: string; // the default, shown where nothing is typed
  fault?: string | undefined;
  input: (path: string, text: string) => void;
}

export function Field({ path, spec, text, standard, fault, input }: FieldProps) {
  const id = `field-${path.replaceAll(".", "-")}`;
  const common = {
    id,
    name: path,
    "aria-invalid": fault !== undefined,
    "aria-describedby": `${id}-note`,
  };
  return (
    <div class={`field${fault ? " wrong" : ""}`}>
      <label for={id}>
        {spec.label}
        {spec.unit && <small>{`, ${spec.unit}`}</small>}
      </label>
      {spec.choices ? (
        <select {...common} value={text || spec.choices[0]![0]} onChange={(e) => input(path, e.currentTarget.value)}>
          {spec.choices.map(([value, title]) => <option key={value} value={value}>{title}</option>)}
        </select>
      ) : (
        <input
          {...common}
          type="text"
          inputMode="decimal"
          autocomplete="off"
          spellcheck={false}
          value={text}
          placeholder={standard ?? ""}
          onInput={(e) => input(path, e.currentTarget.value)}
        />
      )}
      <p class="note" id={`${id}-note`} role={fault ? "alert" : undefined}>
        {fault ?? spec.range}
      </p>
    </div>
  );
}

export function InitialConditionFields(props: {
  form: Form;
  texts: Texts;
  faults: Record<string, string>;
  scenario: Scenario | undefined;
  choose: (form: Form, texts: Texts) => void;
  input: (path: string, text: string) => void;
}) {
  const { form, scenario } = props;
  const titles: [Form, string][] = [
    ["chaser", "the scenario's chaser"],
    ["keplerian", "Keplerian"],
    ["equinoctial", "equinoctial"],
    ["cartesian", "Cartesian"],
  ];
  const choose = (to: Form) => {
    const mu = scenario?.gravitational_parameter_km3_s2 || 398600.4418;
    props.choose(to, scenario ? chaserTexts(to, scenario.chaser, mu) : {});
  };
  return (
    <fieldset>
      <legend>Initial condition of the chaser</legend>
      <div class="choices" role="radiogroup" aria-label="Form of the initial condition">
        {titles.map(([value, title]) => (
          <label key={value}>
            <input type="radio" name="ic-form" value={value} checked={form === value} onChange={() => choose(value)} />
            {title}
          </label>
        ))}
      </div>
      {form !== "chaser" && (
        <div class="fields">
          {forms[form].map((spec) => {
            const path = `initial_condition.${form}.${spec.key}`;
            return (
              <Field key={path} path={path} spec={spec} text={props.texts[path] ?? ""} fault={props.faults[path]} input={props.input} />
            );
          })}
        </div>
      )}
    </fieldset>
  );
}
