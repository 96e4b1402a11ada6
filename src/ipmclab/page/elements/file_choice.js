// A file of the person at the browser, sent as it is; the server says where it keeps it.
export default {
  template: `
    <div class="lab-field">
      <label :for="id">{{ options.label }}</label>
      <span class="lab-field-input lab-file"><input type="file" :id="id" :accept="options.accept" @change="take($event.target)"> {{ name }}</span>
      <p v-if="message" role="alert" class="lab-bad lab-field-message">{{ message }}</p>
    </div>`,
  props: { options: Object },
  data() {
    return { id: `lab-file-${Math.random().toString(36).slice(2)}`, message: "", name: "" };
  },
  methods: {
    take(input) {
      const [file] = input.files;
      input.value = ""; // so that it can be chosen again when it was mended
      if (!file) return;
      this.name = file.name;
      this.send(file);
    },
    async send(file) {
      this.message = "";
      if (file.size > this.options.most) {
        this.message = `The file has ${(file.size / 2 ** 20).toFixed(0)} MiB, at most ${this.options.most / 2 ** 20} can be sent; copy it into the folder of this page.`;
        return;
      }
      try {
        const answer = await fetch(`/uploads?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
        const told = await answer.json();
        if (answer.ok) this.$emit("sent", told);
        else this.message = told.message;
      } catch (error) {
        this.message = `The file could not be sent: ${error.message}`;
      }
    },
  },
};
